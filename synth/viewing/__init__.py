"""Where was a clip made? The room of a simulated clip as a picture; `dmae.viewing` draws the people."""
