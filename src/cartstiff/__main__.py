"""The command ``cartstiff``, and ``python -m cartstiff``."""

import _signal as signal  # type: ignore[import-not-found]  # `signal` itself loads more

# An interrupt while the imports run ends the process as it ends any other program:
# without a word.
_before = signal.signal(signal.SIGINT, signal.SIG_DFL)

from cartstiff.shown.cli.main import main  # noqa: E402

signal.signal(signal.SIGINT, _before)

if __name__ == "__main__":
    main()
