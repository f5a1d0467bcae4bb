"""Calibrate a heavy vehicle from a campaign folder: ``python calibrate.py --help``."""

from sysid.cli.main import main

if __name__ == "__main__":
    main()
