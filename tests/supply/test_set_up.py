"""A set-up from a lock file, with an index of this test that has newer releases of everything."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest

from tests.supply.lock import ROOT

REQUIRES = {"tool": ["part[fast]", "part"], "part": ['speed ; extra == "fast"'], "speed": []}
"""What each package of the index requires: one of them plainly and with an extra."""


def wheel(index: Path, name: str, version: str) -> Path:
    """Put a wheel into the index; return its path."""
    folder = index / name
    folder.mkdir(parents=True, exist_ok=True)
    path, info = folder / f"{name}-{version}-py3-none-any.whl", f"{name}-{version}.dist-info"
    lines = [f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\nProvides-Extra: fast"]
    lines += [f"Requires-Dist: {text}" for text in REQUIRES[name]]
    files = {
        f"{name}.py": "",
        f"{info}/METADATA": "\n".join(lines) + "\n",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    record = "".join(f"{each},,\n" for each in (*files, f"{info}/RECORD"))
    with ZipFile(path, "w") as archive:
        for each, text in (files | {f"{info}/RECORD": record}).items():
            archive.writestr(each, text)
    return path


@pytest.fixture
def index(tmp_path: Path) -> Path:
    """Return an index with the releases 1.0 and 2.0 of everything; 2.0 came after the lock."""
    for name in REQUIRES:
        files = [wheel(tmp_path / "index", name, version) for version in ("1.0", "2.0")]
        links = "".join(f'<a href="{file.name}">{file.name}</a>' for file in files)
        (files[0].parent / "index.html").write_text(f"<!DOCTYPE html><html>{links}</html>")
    return tmp_path / "index"


def lock(index: Path, *names: str) -> Path:
    """Write a lock file of release 1.0 of some packages."""
    path = index.parent / "lock.txt"
    lines = []
    for name in names:
        digest = hashlib.sha256((index / name / f"{name}-1.0-py3-none-any.whl").read_bytes())
        lines.append(f"{name}==1.0 \\\n    --hash=sha256:{digest.hexdigest()}\n")
    path.write_text("".join(lines))
    return path


def set_up(index: Path, lock_file: Path) -> "subprocess.CompletedProcess[str]":
    """Make an environment as the scripts do, without uv; print its packages at the end."""
    environment = index.parent / "environment"
    script = f"""
        set -eu
        . .ci/environment.sh
        uv=
        make_environment {environment} {sys.executable}
        install_lock {environment} {lock_file}
        check_whole {environment}
        {environment}/bin/python -m pip list --format freeze
    """
    environ = {
        name: text
        for name, text in os.environ.items()
        if not name.startswith(("PIP_", "PYTHONPATH"))
    }
    return subprocess.run(
        ["/bin/sh", "-c", script],
        env=environ | {"PIP_INDEX_URL": index.as_uri(), "PIP_CONFIG_FILE": os.devnull},
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )


def test_newer_releases_are_not_taken(index: Path) -> None:
    """A package that others ask for plainly and with extras does not make pip look for another."""
    done = set_up(index, lock(index, "tool", "part", "speed"))

    assert done.returncode == 0, done.stderr
    assert {"tool==1.0", "part==1.0", "speed==1.0"} <= set(done.stdout.split())


@pytest.mark.stress
def test_lock_that_is_not_whole_is_refused(index: Path) -> None:
    """What a lock file lacks is named, and not fetched."""
    done = set_up(index, lock(index, "tool"))

    assert done.returncode != 0
    assert "part" in done.stderr
