"""HOW IS A COMMAND GIVEN? Help, spelling of options, outputs and interruption of both programs."""
