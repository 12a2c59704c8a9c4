"""The base of every model of a configuration, and fields that know their range and unit."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Protocol, TypeAlias, cast

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

# Path within the model to the value that breaks a rule, and what is wrong with it.
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
    """What the configuration must know of drivers; `piezod.devices.registry` is one."""

    def names(self) -> Iterable[str]:
        """Give the names of the drivers that are installed."""
        ...

    def load(self, name: str) -> _Plugin:
        """Give a driver's plug-in: the model of its options, and the channels that these make.

        Raises:
            PiezodError: If there is no such driver, or it cannot be loaded.
        """
        ...


@dataclass(frozen=True)
class Context:
    """What validation needs beside the data.

    Attributes:
        folder: Where relative paths in the file start.
        drivers: The drivers whose options can be validated.
        known_keys: Keys that the model of a mapping knows, by the id of the mapping's data.
    """

    folder: Path = Path()
    drivers: Drivers | None = None
    known_keys: dict[int, Sequence[str]] = field(default_factory=dict)


def context_of(info: ValidationInfo) -> Context:
    """Give the context of a validation; models built in Python have an empty one."""
    return info.context if isinstance(info.context, Context) else Context()


class ConfigModel(BaseModel):
    """Base of every model of a configuration, those of drivers' options included.

    Values are taken as they are: a text or a bool is no number, and unknown keys are errors.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _note_known_keys(cls, data: Any, info: ValidationInfo) -> Any:
        context_of(info).known_keys[id(data)] = tuple(cls.model_fields)
        return data


def broken_rule(what: str) -> PydanticCustomError:
    """Make the error of a rule that a schema cannot state; `what` is the whole text."""
    return PydanticCustomError("rule", "{what}", {"what": what})


def raise_rules(broken: Iterable[BrokenRule]) -> None:
    """Raise the rules that are broken, if any are; for validators of whole models.

    Raises:
        ValidationError: If there is anything.
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
    """A number's closed range and unit; annotates a float or an int.

    Attributes:
        low: Lowest allowed value.
        high: Highest allowed value.
        unit: Symbol of the unit, empty for pure numbers and for values whose unit the key gives.
    """

    low: float
    high: float
    unit: str = ""

    def __str__(self) -> str:
        """Give the range as in an error text."""
        return f"allowed range {self.low:.12g} to {self.high:.12g} {self.unit}".rstrip()

    def __get_pydantic_core_schema__(
        self, source: type, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Make the schema of a bounded number whose errors tell the whole range with its unit."""
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
