"""The parameters of a stage as the bytes of a file, with a checksum."""

import hashlib
import json
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import Field, StringConstraints, ValidationError

from piezod.config.fields import ConfigModel, Quantity
from piezod.config.model_file import ModelFile
from piezod.config.quantities import Name, PositionUm
from piezod.errors import DataError

MAX_BYTES: Final = 4 << 20
"""Largest size of a file; 16 axes of 2000 weights are well below."""

OFFSET_LIMIT: Final = 1.0
SCALE_LIMIT: Final = 0.3
"""Limits of an identifier, as in `hysteresis.learner`. The supervisor does not import that module,
because it would load the compiled kernels."""

_Line: TypeAlias = Annotated[str, StringConstraints(min_length=1, max_length=255)]
_Digest: TypeAlias = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]


class AxisParameters(ConfigModel):
    """The learned parameters of one axis."""

    model: ModelFile | None = Field(description="The model with its weights, if there is one.")
    zero_um: PositionUm = Field(description="Sensor zero, µm.")
    offset: Annotated[float, Quantity(-OFFSET_LIMIT, OFFSET_LIMIT)] = Field(
        default=0.0, description="Offset of the normalised displacement."
    )
    scale: Annotated[float, Quantity(-SCALE_LIMIT, SCALE_LIMIT)] = Field(
        default=0.0, description="Relative excess of the displacement over that of the model."
    )


class ParameterDocument(ConfigModel):
    """The parameters of a stage in the form in which they are stored."""

    format: Literal["piezod-parameters"] = "piezod-parameters"
    version: Literal[1] = 1
    sequence: Annotated[int, Quantity(1, 10**9)] = Field(description="Counts the saves.")
    stage: _Line = Field(description="Name of the stage.")
    saved_at: _Line = Field(description="Instant of the save, ISO 8601 with the offset from UTC.")
    saved_by: _Line = Field(description="User who saved them.")
    axes: dict[Name, AxisParameters] = Field(min_length=1, max_length=16)
    sha256: _Digest = Field(
        default="0" * 64, description="SHA-256 of this file with 64 zeros in this place."
    )


def encode(document: ParameterDocument) -> bytes:
    """Return the bytes of a document, with its checksum; a document has only one such form."""
    unsigned = _text(document, "0" * 64)
    return _text(document, hashlib.sha256(unsigned).hexdigest())


def decode(content: bytes) -> ParameterDocument:
    """Return the document of a file.

    Every other byte than those that `encode` wrote is detected, even if it changes no value.

    Raises:
        DataError: If it is not exactly what `encode` writes. The text does not name the file. The
            loop checks later whether it can use the models.
    """
    if len(content) > MAX_BYTES:
        raise DataError(f"it is larger than {MAX_BYTES} bytes: `params save` did not write it")
    try:
        data = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise DataError(f"it is not JSON ({error}): it is cut off or damaged") from error
    # Before the validation: a newer version must not be reported as damage.
    _check_kind(data)
    try:
        document = ParameterDocument.model_validate(_with_tuples(data))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise DataError(f"it is damaged: {where}: {first['msg']}") from error
    # Compare all bytes, not only the checksum: JSON has many forms of the same values.
    expected = encode(document)
    if expected != content:
        raise DataError("it is damaged or was edited: its checksum does not fit its contents")
    return document


def _check_kind(data: object) -> None:
    if not isinstance(data, dict) or data.get("format") != "piezod-parameters":
        raise DataError("it does not hold parameters of a stage")
    version = data.get("version")
    if version != 1:
        raise DataError(
            f"it has version {str(version)[:20]!r}, this piezod reads version 1; "
            "use the piezod that wrote it, or identify again"
        )


def _text(document: ParameterDocument, digest: str) -> bytes:
    data = document.model_copy(update={"sha256": digest}).model_dump(mode="json")
    return (json.dumps(data, indent=1, ensure_ascii=False) + "\n").encode(errors="backslashreplace")


def _with_tuples(data: Any) -> Any:
    """Return JSON data with tuples instead of lists, which strict models require."""
    if isinstance(data, dict):
        return {key: _with_tuples(value) for key, value in data.items()}
    return tuple(map(_with_tuples, data)) if isinstance(data, list) else data
