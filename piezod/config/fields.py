"""The base of all configuration models, and numeric fields with range and unit."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Protocol, Self, TypeAlias, cast

from pydantic import (
    BaseModel,
    ConfigDict,
    GetCoreSchemaHandler,
    ValidationError,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    model_validator,
)
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError, core_schema

from piezod.config.document import KeyPath
from piezod.config.messages import show

# Path within the model to the value that breaks a rule, and the message.
BrokenRule: TypeAlias = tuple[KeyPath, str]


class _Units(Protocol):
    @property
    def inputs(self) -> Mapping[str, str]: ...

    @property
    def outputs(self) -> Mapping[str, str]: ...


class _Plugin(Protocol):
    @property
    def options_model(self) -> type[BaseModel]: ...

    @property
    def channels(self) -> Callable[[Any], _Units | None]: ...


class Drivers(Protocol):
    """Part of the driver registry that validation uses, as `piezod.devices.registry`."""

    def names(self) -> Iterable[str]:
        """Return the names of the installed drivers."""
        ...

    def load(self, name: str) -> _Plugin:
        """Return a driver's plug-in: the model of its options, and the channels for given options.

        Raises:
            PiezodError: If the driver does not exist or cannot be loaded.
        """
        ...


@dataclass(frozen=True)
class Context:
    """Data that validation needs besides the document."""

    folder: Path = Path()  #: Folder of relative paths in the file.
    drivers: Drivers | None = None  #: Drivers whose options can be validated.
    #: Known keys of each mapping, by the id of the mapping's data.
    known_keys: dict[int, Sequence[str]] = field(default_factory=dict)
    #: Digest of each file that the document names, by its absolute path, from before it is read.
    named_files: dict[str, str] = field(default_factory=dict)


def context_of(info: ValidationInfo) -> Context:
    """Return the context of a validation; models built in Python have an empty one."""
    return info.context if isinstance(info.context, Context) else Context()


class ConfigModel(BaseModel):
    """Base of all configuration models, including those of drivers' options.

    Values are not converted: a text or a bool is not a number. Unknown keys are errors. A model
    whose values must fit each other overrides `_broken_rules`.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _note_known_keys(cls, data: Any, info: ValidationInfo) -> Any:
        # By identity, because pydantic's errors do not name the model that a mapping was read by.
        context_of(info).known_keys[id(data)] = tuple(cls.model_fields)
        return data

    @model_validator(mode="after")
    def _check_rules_of_values(self) -> Self:
        raise_rules(self._broken_rules())
        return self

    def _broken_rules(self) -> Iterable[BrokenRule]:
        """Return the rules that the values break together, each valid by itself."""
        return ()


def broken_rule(what: str) -> PydanticCustomError:
    """Return the error of a rule that a schema cannot state; `what` is the whole text."""
    return PydanticCustomError("rule", "{what}", {"what": what})


def raise_rules(broken: Iterable[BrokenRule]) -> None:
    """Raise an error for broken rules, if there are any; for validators of whole models.

    Raises:
        ValidationError: If a rule is broken.
    """
    details = [
        InitErrorDetails(type=broken_rule(what), loc=path, input=None) for path, what in broken
    ]
    if details:
        raise ValidationError.from_exception_data("rules", details)


_NUMBER_ERRORS: Final = {
    "float_type": "must be a number",
    "finite_number": "must be a finite number",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
}


@dataclass(frozen=True)
class Quantity:
    """Closed range and unit of a number; annotates a float or an int."""

    low: float  #: Lowest allowed value.
    high: float  #: Highest allowed value.
    unit: str = ""  #: Symbol of the unit; empty for pure numbers and if the key contains the unit.

    def __str__(self) -> str:
        """Return the range as in an error message."""
        return f"allowed range {self.low:.12g} to {self.high:.12g} {self.unit}".rstrip()

    def __get_pydantic_core_schema__(
        self, source: type, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Return the schema of a bounded number whose errors state the range with its unit."""
        # pydantic's own schema checks the bounds; the wrapper only words its errors.
        inner = {**handler(source), "ge": self.low, "le": self.high}
        return core_schema.no_info_wrap_validator_function(
            self._validate, cast("CoreSchema", inner)
        )

    def _validate(self, value: object, handler: ValidatorFunctionWrapHandler) -> object:
        try:
            return handler(value)
        except ValidationError as error:
            kind = error.errors()[0]["type"]
            what = _NUMBER_ERRORS.get(kind, "out of range")
            raise broken_rule(f"{what} (got {show(value)}), {self}") from error
