"""structlog without rich.

structlog imports rich, and pygments with it, if it finds them, for tracebacks in a form that the
log does not use. That is 3 MB of each supervisor. structlog has no option against it; it takes a
module that is None in `sys.modules` for absent. Afterwards rich can be imported as before.
"""

import sys

_before = sys.modules.get("rich")
if _before is None:
    sys.modules["rich"] = None  # type: ignore[assignment] # Python's sign for an absent module
import structlog  # noqa: E402 - see above

if _before is None:
    del sys.modules["rich"]

__all__ = ["structlog"]
