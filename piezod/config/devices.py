"""Devices: the driver and its options."""

from typing import Any

from pydantic import BaseModel, Field, SerializeAsAny, ValidationInfo, field_validator

from piezod.config.fields import ConfigModel, broken_rule, context_of
from piezod.config.messages import show, suggest
from piezod.errors import PiezodError


class NoOptions(ConfigModel):
    """Placeholder for the options of an unknown driver."""


class DeviceConfig(ConfigModel):
    """A device that a driver drives."""

    driver: str = Field(description="Name of the driver, as listed by `piezod drivers`.")
    options: SerializeAsAny[BaseModel] = Field(
        default_factory=dict,
        validate_default=True,
        description="Options of the driver; the driver's own model validates them.",
    )

    @field_validator("driver")
    @classmethod
    def _check_driver(cls, name: str, info: ValidationInfo) -> str:
        drivers = context_of(info).drivers
        if drivers is None:
            return name
        known = sorted(drivers.names())
        if name not in known:
            raise broken_rule(f"unknown driver (got {show(name)}), {suggest(name, known, 'known')}")
        try:
            drivers.load(name)
        except PiezodError as error:
            raise broken_rule(str(error)) from error
        return name

    @field_validator("options", mode="plain")
    @classmethod
    def _validate_options(cls, options: Any, info: ValidationInfo) -> BaseModel:
        if isinstance(options, BaseModel):
            return options
        drivers = context_of(info).drivers
        if "driver" not in info.data:
            return NoOptions()  # the error about the driver's name is reported already
        if drivers is None:
            raise broken_rule("options must be an instance of the driver's own model")
        model = drivers.load(info.data["driver"]).options_model
        context_of(info).known_keys[id(options)] = tuple(model.model_fields)
        return model.model_validate(options, context=info.context)
