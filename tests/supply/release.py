"""What is released: `python -m tests.supply.release`, as `make release` runs it.

Builds sdist, wheel and parts list in `dist/`, and checks them. Refuses a tree with changes, and a
version without notes. Tags nothing and uploads nothing: it prints what remains to be done.
"""

import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
DIST: Final = "dist"
STEPS: Final = (
    ("make", "--no-print-directory", "wheel"),
    (".ci/check-package", DIST),
    (".venv/bin/python", "-m", "pytest", "--quiet", "tests/test_packaging.py", "tests/supply"),
)
_HEADING: Final = re.compile(r"^## \[(?P<version>[^\]]+)\](?: - (?P<day>\d{4}-\d\d-\d\d))?$", re.M)


def version_of(root: Path) -> str:
    """Return the version of the project file, which is the only place that says it."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return str(project["version"])


def refusals(root: Path) -> Iterator[str]:
    """Yield each reason why a checkout cannot be released, with its remedy.

    Args:
        root: The folder of the checkout.
    """
    version = version_of(root)
    newest = _HEADING.search((root / "CHANGELOG.md").read_text(encoding="utf-8"))
    if newest is None or newest["version"] != version:
        found = newest["version"] if newest else "none"
        yield (
            f"CHANGELOG.md begins with notes of [{found}], and pyproject.toml has {version}: write "
            f"'## [{version}] - YYYY-MM-DD', or change the version"
        )
    elif newest["day"] is None:
        yield f"the notes of {version} in CHANGELOG.md have no day: '## [{version}] - YYYY-MM-DD'"
    if _git(root, "tag", "--list", f"v{version}"):
        yield f"the tag v{version} exists: this version was released; raise it in pyproject.toml"
    if changed := _git(root, "status", "--porcelain"):
        yield f"the tree has changes; commit or remove them:\n{changed}"


def missing(dist: Path, version: str) -> list[str]:
    """Return the names of the files that a release needs and a folder lacks."""
    names = (
        f"piezod-{version}.tar.gz",
        f"piezod-{version}-py3-none-any.whl",
        f"piezod-{version}.cdx.json",
    )
    return [name for name in names if not (dist / name).is_file()]


def main() -> int:
    """Refuse, or build, check, and say what to do next; return the exit code."""
    reasons = list(refusals(ROOT))
    for reason in reasons:
        print(f"make release: {reason}", file=sys.stderr)
    if reasons:
        return 1
    version = version_of(ROOT)
    shutil.rmtree(ROOT / DIST, ignore_errors=True)  # so that nothing of another version is in there
    for step in STEPS:
        subprocess.run(step, cwd=ROOT, check=True)
    if absent := missing(ROOT / DIST, version):
        print(f"make release: {DIST}/ lacks {', '.join(absent)}", file=sys.stderr)
        return 1
    print(f"""
{DIST}/ has piezod {version}: sdist, wheel and parts list. Nothing was tagged or uploaded. Next:
  make check && make vm                         # if they have not passed on this commit
  git tag --annotate v{version} --message 'piezod {version}' && git push origin v{version}
  upload {DIST}/*.tar.gz and {DIST}/*.whl to the index, and the parts list beside the notes""")
    return 0


def _git(root: Path, *arguments: str) -> str:
    command = ("git", "-C", str(root), *arguments)
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return done.stdout.rstrip()


if __name__ == "__main__":
    sys.exit(main())
