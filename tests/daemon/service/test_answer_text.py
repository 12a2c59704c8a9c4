"""What answers make of a path whose bytes are no text."""

import json
import os

from piezod.messages.documents import dump


def test_path_that_is_no_text_survives_as_json() -> None:
    """Any path can be sent, and names the same file for the receiver; text stays readable."""
    path = os.fsdecode(b"/data/st\xfcck.yaml")
    sent = dump({"config": path, "title": "Prüfstand µ"})

    assert json.loads(sent) == {"config": path, "title": "Prüfstand µ"}
    assert "Prüfstand µ".encode() in sent
