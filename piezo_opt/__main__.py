"""``python -m piezo_opt`` is the command ``piezo-opt``: both begin here.

Nothing is imported before :func:`main` runs, so that Ctrl-C is answered from the first moment on.
"""

import os
import sys


def main() -> None:
    """Entry point of the command ``piezo-opt``."""
    # Long arrays with few columns: a second thread of linear algebra mostly waits, at full power.
    # numpy reads this when it is first imported; what the user has set stays.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        from piezo_opt.cli import main as command
    except KeyboardInterrupt:
        print("Interrupted before there was a result.", file=sys.stderr)
        raise SystemExit(130) from None
    command()


if __name__ == "__main__":
    main()
