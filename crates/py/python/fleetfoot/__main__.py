"""The command as a module: ``python -m fleetfoot``."""

from fleetfoot_command import main

if __name__ == "__main__":
    main()
