"""The command line as a module: ``python -m sysid``."""

from sysid.cli.main import main

if __name__ == "__main__":
    main()
