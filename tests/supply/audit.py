"""Known vulnerabilities of `requirements.lock`, licences of .venv; `make audit` runs it.

Vulnerabilities come from a service in the network. A version with known vulnerabilities is asked
about first: a service that does not report these has no answer for the others either. Then it
prints `not checked:` and the reason, and does not fail, because nothing was found.
"""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).parents[2]
TOOLS: Final = ROOT / "build" / "audit" / "bin"
LOCK: Final = ROOT / "requirements.lock"
VULNERABLE: Final = "pyyaml==5.3\n"
"""It runs code that a YAML file contains: CVE-2020-14343."""
LONGEST_S: Final = 10
"""Longest wait for one answer of the service, in s."""


class Reply(NamedTuple):
    """What pip-audit reports about a file of requirements."""

    vulnerable: tuple[str, ...]  #: Vulnerabilities, one line each.
    skipped: tuple[str, ...] = ()  #: Packages that the service does not know, one line each.
    error: str = ""  #: Why there is no report; empty if there is one.


Ask = Callable[[Path], Reply]


def read_report(output: str, errors: str) -> Reply:
    """Read the report of pip-audit, or its last message if there is no report."""
    try:
        dependencies = json.loads(output)["dependencies"]
    except ValueError:
        return Reply((), error=(errors.strip().splitlines() or ["pip-audit printed nothing"])[-1])
    return Reply(
        tuple(line for each in dependencies for line in _vulnerabilities(each)),
        tuple(each["skip_reason"] for each in dependencies if "skip_reason" in each),
    )


def _vulnerabilities(dependency: dict[str, object]) -> Iterator[str]:
    vulnerabilities = dependency.get("vulns")
    for found in vulnerabilities if isinstance(vulnerabilities, list) else ():
        fixed = (
            f"fixed in {', '.join(found['fix_versions'])}" if found["fix_versions"] else "no fix"
        )
        yield f"{dependency['name']} {dependency['version']}: {found['id']}, {fixed}"


def pip_audit(requirements: Path) -> Reply:
    """Ask the service about pinned requirements, without installing them."""
    options = ("--no-deps", "--disable-pip", "--progress-spinner", "off", "--format", "json")
    command = (TOOLS / "pip-audit", *options, "--timeout", str(LONGEST_S), "-r", requirements)
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return read_report(done.stdout, done.stderr)


def check_vulnerabilities(ask: Ask, scratch: Path) -> int:
    """Print the known vulnerabilities; return the exit code."""
    known = scratch / "known-vulnerable.txt"
    known.write_text(VULNERABLE, encoding="utf-8")
    trial = ask(known)
    reply = ask(LOCK) if trial.vulnerable else trial
    if not trial.vulnerable or reply.error:
        why = (reply.error, *reply.skipped, "the service reports no known vulnerability")
        print(f"not checked: vulnerabilities of the dependencies: {next(filter(None, why))}")
        return 0
    for reason in reply.skipped:
        print(f"not checked: {reason}")
    for line in reply.vulnerable:
        print(f"vulnerable: {line}")
    print(f"{LOCK.name}: {len(reply.vulnerable)} known vulnerabilities")
    return int(bool(reply.vulnerable))


def check_licences() -> int:
    """Compare the licences of all packages of .venv with the allowed ones; return the exit code."""
    # The allowed ones are in pyproject.toml, where pip-licenses looks for them.
    command = (TOOLS / "pip-licenses", "--python", ROOT / ".venv" / "bin" / "python")
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=False)
    if not done.returncode:
        print(f"licences: those of all {len(done.stdout.splitlines()) - 1} packages are allowed")
    return done.returncode


def main() -> int:
    """Check both; return the exit code."""
    return max(check_licences(), check_vulnerabilities(pip_audit, ROOT / "build" / "audit"))


if __name__ == "__main__":
    sys.exit(main())
