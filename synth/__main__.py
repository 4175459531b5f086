"""`python -m synth`, for shells that do not find the `synth` script."""

from synth.cli import main

if __name__ == "__main__":
    main()
