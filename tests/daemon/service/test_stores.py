import socket
from pathlib import Path

import httpx
import pytest

from piezod.daemon.service.connection import ConnectionLimits
from piezod.daemon.service.long_answers import open_recording
from piezod.daemon.stage.errors import UnknownNameError
from piezod.messages.stores import RunningRecording
from tests.daemon.service.conftest import Serve
from tests.daemon.service.fakes import Served
from tests.daemon.service.raw import connected, wait_for_hang_up

NAME = "20261121T120000Z"
GET = b"GET /v1/recordings/big HTTP/1.1\r\nhost: piezod\r\n\r\n"


def test_parameters_are_saved_and_restored(served: Served, client: httpx.Client) -> None:
    """The numbers of the stage are returned, and the audit has every request."""
    assert client.get("params").json() == {"axes": {}, "sequence": 3}
    assert client.get("params/history").json()["history"][0]["sequence"] == 3
    assert client.post("params/save").json() == {"sequence": 4}
    assert client.post("params/load").json()["sequence"] == 3
    assert client.post("params/restore", json={"sequence": 2}).json()["sequence"] == 2
    assert [entry.what for entry in served.stage.audited] == [
        "params save",
        "params load",
        "params restore 2",
    ]


def test_parameters_that_do_not_exist_are_not_found(client: httpx.Client) -> None:
    """The error of the stage reaches the client."""
    answer = client.post("params/restore", json={"sequence": 99})

    assert (answer.status_code, answer.json()["error"]["code"]) == (404, "not_found")


def test_configuration_is_read_again(client: httpx.Client) -> None:
    """The document of the stage is the answer."""
    assert client.post("reload").json() == {"changes": ["by somebody"], "lost": []}


def test_recording_is_started_and_stopped(client: httpx.Client) -> None:
    """The label becomes part of the name."""
    started = client.post("recordings/start", json={"label": "Run-1"}).json()
    stopped = client.post("recordings/stop").json()

    assert (started["name"], started["recording"]) == (f"{NAME}-Run-1", True)
    assert (stopped["name"], stopped["records"], stopped["lost"]) == (NAME, 5, 0)


def test_recording_waits_for_an_edge(client: httpx.Client) -> None:
    """The answer says that it is armed; an instant and an edge exclude each other."""
    edge = {"line": "exposed", "before_s": 2.5}
    started = client.post("recordings/start", json={"label": "a", "edge": edge})
    both = client.post("recordings/start", json={"edge": edge, "start_s": 1e6})
    longer = client.post("recordings/start", json={"edge": {**edge, "before_s": 60}})

    assert started.json()["armed"]
    assert (both.status_code, longer.status_code) == (422, 422)


@pytest.mark.fault("C7")
@pytest.mark.parametrize("label", ["../a", "a/b", "a b", "", "a" * 33, "a\n", ".a"])
def test_label_is_no_path(client: httpx.Client, label: str) -> None:
    """A label with characters of a path is refused."""
    assert client.post("recordings/start", json={"label": label}).status_code == 422


def test_recording_arrives_as_it_is(served: Served, client: httpx.Client) -> None:
    """Every byte of a finished recording is sent."""
    content = bytes(range(256)) * 4096
    served.stage.recordings_folder.joinpath(f"{NAME}.h5").write_bytes(content)
    answer = client.get(f"recordings/{NAME}")

    assert answer.content == content
    assert answer.headers["content-type"] == "application/x-hdf5"
    assert client.get("recordings").json() == {
        "running": None,
        "recordings": [{"name": NAME, "size_bytes": 0, "kept": False}],
        "folder": str(served.stage.recordings_folder),
    }


def test_recording_that_is_being_made_is_not_sent(served: Served, client: httpx.Client) -> None:
    """The file that is being written cannot be downloaded; earlier files of a recording can."""
    for name in (NAME, f"{NAME}-0002"):
        served.stage.recordings_folder.joinpath(f"{name}.h5").write_bytes(b"HDF")
    served.stage.running = RunningRecording(True, NAME, file=f"{NAME}-0002")

    assert client.get(f"recordings/{NAME}-0002").status_code == 409
    assert client.get(f"recordings/{NAME}").content == b"HDF"
    assert client.get("recordings").json()["running"]["name"] == NAME


def test_recording_is_kept(client: httpx.Client) -> None:
    """A name is marked, the mark is removed, and a path is no name."""
    kept = client.post("recordings/keep", json={"name": NAME})
    not_kept = client.post("recordings/keep", json={"name": NAME, "kept": False})

    assert (kept.json()["kept"], not_kept.json()["kept"]) == (True, False)
    assert client.post("recordings/keep", json={"name": "../a"}).status_code == 422


@pytest.mark.fault("C7")
@pytest.mark.parametrize(
    "path",
    [
        "../secret",
        "..%2fsecret",
        "%2e%2e%2fsecret",
        "..%252fsecret",
        "..%5csecret",
        "%2fetc%2fpasswd",
        "secret%00",
        "link",
        "folder",
        "pipe",
        ".hidden",
        "a" * 300,
        "%c3%28",
        "missing",
    ],
)
def test_nothing_but_a_recording_is_sent(served: Served, tmp_path: Path, path: str) -> None:
    """A name outside the folder, or of no plain file in it, is unknown."""
    folder = tmp_path / "recordings"
    folder.mkdir()
    served.stage.recordings_folder = folder
    tmp_path.joinpath("secret.h5").write_bytes(b"secret")
    folder.joinpath(".hidden.h5").write_bytes(b"secret")
    folder.joinpath("link.h5").symlink_to(tmp_path / "secret.h5")
    folder.joinpath("folder.h5").mkdir()
    with socket.socket(socket.AF_UNIX) as pipe, connected(served.socket) as connection:
        pipe.bind(str(folder / "pipe.h5"))
        request = f"GET /v1/recordings/{path} HTTP/1.1\r\nhost: piezod\r\nconnection: close\r\n\r\n"
        connection.sendall(request.encode())
        answer = connection.recv(65536)

    assert answer.startswith(b"HTTP/1.1 404"), answer
    assert b"secret.h5" not in answer


def test_recording_of_a_folder_that_is_missing_is_not_found(tmp_path: Path) -> None:
    """Without any recording the folder may be absent."""
    with pytest.raises(UnknownNameError):
        open_recording(tmp_path / "nothing", NAME)


@pytest.mark.fault("C14")
def test_user_gets_one_recording_at_a_time(serve: Serve) -> None:
    """A second download is refused until the first one has ended."""
    served = serve(ConnectionLimits(blocked_s=0.5))
    served.stage.recordings_folder.joinpath("big.h5").write_bytes(bytes(8 << 20))
    with connected(served.socket) as connection, served.client() as client:
        connection.sendall(GET)
        connection.recv(10)
        during = client.get("recordings/big")
        wait_for_hang_up(connection)
        after = client.get("recordings/big")

    assert (during.status_code, during.json()["error"]["code"]) == (429, "too_many")
    assert (after.status_code, len(after.content)) == (200, 8 << 20)
