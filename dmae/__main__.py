"""`python -m dmae`, for shells that do not find the `dmae` script."""

from dmae.cli import main

if __name__ == "__main__":
    main()
