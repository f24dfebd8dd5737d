"""``python -m cartstiff``."""

from cartstiff.cli.main import main

if __name__ == "__main__":
    main()
