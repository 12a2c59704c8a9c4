"""Tests of the audit: a finding, a healthy set and a service that cannot answer are told apart."""

import json
from pathlib import Path

import pytest

from tests.supply.audit import LOCK, Reply, check_vulnerabilities, read_report

KNOWN = Reply(("pyyaml 5.3: CVE-2020-14343, fixed in 5.4",))
NOT_FOUND = "Dependency not found on PyPI and could not be audited: pyyaml (5.3)"


@pytest.mark.parametrize(
    ("trial", "reply", "code", "printed"),
    [
        (KNOWN, Reply(()), 0, "0 known vulnerabilities"),
        (KNOWN, Reply(("numpy 1.0: X-1, no fix",)), 1, "vulnerable: numpy 1.0: X-1, no fix"),
        (KNOWN, Reply((), ("no such package",)), 0, "not checked: no such package"),
        (KNOWN, Reply((), error="ServiceError"), 0, "not checked: vulnerabilities of"),
        (Reply((), error="no route to host"), None, 0, "dependencies: no route to host"),
        (Reply((), (NOT_FOUND,)), None, 0, f"dependencies: {NOT_FOUND}"),
        (Reply(()), None, 0, "dependencies: the service reports no known vulnerability"),
    ],
)
def test_a_service_without_an_answer_is_told_apart_from_a_healthy_set(
    trial: Reply,
    reply: Reply | None,
    code: int,
    printed: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Only a finding fails; whatever was not checked is printed, with the reason."""

    def ask(requirements: Path) -> Reply:
        answer = reply if requirements == LOCK else trial
        assert answer is not None
        return answer

    assert check_vulnerabilities(ask, tmp_path) == code
    assert printed in capsys.readouterr().out


def test_report_is_read() -> None:
    """Each vulnerability is a line, with the versions that have it no more."""
    vulnerability = {"id": "CVE-1", "fix_versions": ["5.4", "6.0"], "aliases": []}
    found = [
        {"name": "pyyaml", "version": "5.3", "vulns": [vulnerability]},
        {"name": "numpy", "version": "2.0", "vulns": []},
        {"name": "ours", "skip_reason": "not on PyPI"},
    ]
    reply = read_report(json.dumps({"dependencies": found, "fixes": []}), "found 1")

    assert reply == (("pyyaml 5.3: CVE-1, fixed in 5.4, 6.0",), ("not on PyPI",), "")


@pytest.mark.parametrize(
    ("errors", "reason"),
    [("WARNING: slow\nERROR: no route to host\n", "ERROR: no route to host"), ("", "pip-audit")],
)
def test_without_a_report_the_last_message_is_the_reason(errors: str, reason: str) -> None:
    """A silent failure has a reason, too."""
    assert read_report("", errors).error.startswith(reason)
