"""Tables, figures, videos and HTML pages that present results."""
