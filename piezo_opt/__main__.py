"""``python -m piezo_opt`` is the command ``piezo-opt``."""

from piezo_opt.cli import main

if __name__ == "__main__":
    main()
