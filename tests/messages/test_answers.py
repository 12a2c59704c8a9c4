"""Answers: written by the daemon, read by the clients, described for everybody."""

import json
from dataclasses import fields, is_dataclass
from inspect import signature
from math import inf, nan
from typing import Any, get_origin

import pytest

from piezod.client.commands import StageCommands
from piezod.client.reader import read
from piezod.client.reports import StageReports
from piezod.client.stage_client import StageClient
from piezod.errors import ClientError
from piezod.messages import answers, stores, telemetry
from piezod.messages.answers import AxisStatus, Fault, Holder, Lease, Processor, Status
from piezod.messages.documents import Message, attributes, dump, plain
from piezod.messages.endpoints import Endpoint
from piezod.messages.requests import TABLE
from piezod.messages.stores import Loaded, Recordings, Rejected, RunningRecording
from piezod.telemetry.record import AxisRecord, CycleHeader

CLASSES = [
    each
    for module in (answers, stores, telemetry)
    for each in vars(module).values()
    if isinstance(each, type) and is_dataclass(each)
]
STATUS = Status(
    stage="rig",
    state="RUN",
    mode="adaptive",
    faults=(Fault(id="S5", name="stuck", remedy="look"),),
    skipped_cycles=3,
    processor=Processor(number=2),
    axes={"x": AxisStatus(position_um=1.5, remaining_s=0.25)},
    lease=Lease(holder=Holder(user="ann", uid=1), expires_in_s=None),
)


@pytest.mark.parametrize(
    "answer",
    [
        STATUS,
        Loaded(3, "number 3", (Rejected("4.json", "cut off"),)),
        Recordings(running=RunningRecording(True, "one", 5, file="one-2"), recordings=()),
    ],
    ids=lambda answer: type(answer).__name__,
)
def test_answer_that_was_written_is_read(answer: Message) -> None:
    """A client gets the object that the daemon made, with everything in it."""
    document = json.loads(dump(answer))
    found = read(type(answer), document)

    assert found == answer
    assert found.document == document == answer.document


def test_what_a_newer_daemon_adds_stays_in_the_document() -> None:
    """A client reads the fields that it knows, and keeps the others."""
    document = {**STATUS.document, "colour": "blue"}

    found = read(Status, document)

    assert found == STATUS
    assert found.document["colour"] == "blue"


def test_answer_of_another_form_is_an_error() -> None:
    """The error names what is wrong."""
    with pytest.raises(ClientError, match="skipped_cycles"):
        read(Status, {**STATUS.document, "skipped_cycles": "many"})


def test_numbers_that_json_lacks_are_null() -> None:
    """NaN and infinities are written as null, at any depth."""
    answer = AxisStatus(position_um=nan, command_um=1.5)

    assert json.loads(dump({"axes": [answer], "left_s": inf}))["left_s"] is None
    assert json.loads(dump({"axes": [answer]}))["axes"][0]["position_um"] is None
    assert plain(answer)["command_um"] == 1.5


@pytest.mark.parametrize("declared", [*CLASSES, AxisRecord, CycleHeader])
def test_every_field_has_words(declared: Any) -> None:
    """A field without a description could not be explained in OpenAPI or in a recording."""
    names = declared._fields if issubclass(declared, tuple) else [f.name for f in fields(declared)]

    assert attributes(declared).keys() >= set(names)


@pytest.mark.parametrize("group", [StageCommands, StageReports])
def test_methods_of_the_clients_return_the_answers_of_the_table(group: type) -> None:
    """The annotation of a method and the row of its endpoint name the same class."""
    methods = {name: getattr(StageClient, name) for name in vars(group) if name[0] != "_"}

    for name, method in methods.items():
        returned = signature(method).return_annotation
        assert (get_origin(returned) or returned) is TABLE[name].answer_class, name


@pytest.mark.parametrize("row", TABLE.values(), ids=lambda row: row.name)
def test_every_endpoint_but_a_file_has_a_class(row: Endpoint) -> None:
    """Only a recording is a file."""
    assert (row.answer_class is None) == (row.name == "fetch_recording")
