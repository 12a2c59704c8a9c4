import pytest

from piezod.config.origins import host_name, is_own_host, is_same_origin

OWN = ["localhost", "LOCALHOST:8080", "127.0.0.1:80", "[::1]:8080", "::1", "piezod", "", "10.0.0.7"]
FOREIGN = ["evil.example", "evil.example:80", "localhost.", "1.2.3.4.5", "[evil.example]", "a.b:c"]


@pytest.mark.parametrize("host", OWN)
def test_no_foreign_site_has_an_address_or_a_name_without_a_dot(host: str) -> None:
    """Such a `Host` is that of this machine."""
    assert is_own_host(host)


@pytest.mark.parametrize("host", FOREIGN)
def test_a_name_with_a_dot_may_be_of_anybody(host: str) -> None:
    """A domain name can be made to lead to this machine."""
    assert not is_own_host(host)


def test_host_name_has_no_port() -> None:
    """The port and the case of letters are left out."""
    assert host_name("LabPC.example:8080") == "labpc.example"
    assert host_name("[FE80::1]:8080") == "fe80::1"


def test_same_origin_has_the_same_port() -> None:
    """Another port is another origin; the scheme may be that of a proxy."""
    assert is_same_origin("http://localhost:8080", "localhost:8080")
    assert is_same_origin("https://LabPC", "labpc")
    assert not is_same_origin("http://localhost:8081", "localhost:8080")
    assert not is_same_origin("null", "localhost")
    assert not is_same_origin("http://localhost:8080.evil.example", "localhost:8080")
