"""`python -m coact …` is `coact …`."""

from __future__ import annotations

import os
import subprocess
import sys

from coact._binary import binary


def main() -> int:
    """Runs the binary with the arguments of this process, on its terminal."""
    command = [str(binary()), *sys.argv[1:]]
    if os.name == "posix":
        # In its place: signals and exit code are the binary's own.
        os.execv(command[0], command)
    return subprocess.call(command)


if __name__ == "__main__":
    sys.exit(main())
