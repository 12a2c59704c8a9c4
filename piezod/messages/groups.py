"""The groups of stages of a machine, and files of movements for a group."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, TypeAlias

from pydantic import Field, StringConstraints

from piezod.config.commands import Command
from piezod.config.fields import BrokenRule, ConfigModel, Context
from piezod.config.quantities import DurationS, Name
from piezod.config.validate import validate
from piezod.config.yaml_loader import load_yaml
from piezod.errors import ConfigError, Problem
from piezod.messages.requests import Play

# The stem of the name of a configuration file.
StageName: TypeAlias = Annotated[
    str, StringConstraints(pattern=r"^[^./\x00-\x1f][^/\x00-\x1f]*$", max_length=100)
]


class GroupsFile(ConfigModel):
    """The groups of a machine."""

    groups: dict[Name, tuple[StageName, ...]] = Field(
        min_length=1, description="Name: the stages of the group."
    )

    def _broken_rules(self) -> Iterator[BrokenRule]:
        for name, stages in self.groups.items():
            if not stages:
                yield ("groups", name), "a group has at least one stage"
            for stage, times in Counter(stages).items():
                if times > 1:
                    yield ("groups", name), f"{stage} appears {times} times, allowed: once"


class GroupWaveFile(ConfigModel):
    """Waveforms for stages of a group, which begin together."""

    stages: dict[StageName, Command] = Field(
        min_length=1,
        description="Stage: position, µm; one for a single axis, or `axes:` with one for each.",
    )
    duration_s: DurationS = Field(description="Length, s.")


class GroupPlayFile(ConfigModel):
    """Tables that devices of a group play, begun together."""

    stages: dict[StageName, Play] = Field(
        min_length=1, description="Stage: table, with the keys of `POST /v1/play`."
    )


def load_groups(file: Path) -> dict[str, tuple[str, ...]]:
    """Return the stages of all groups, by the names of the groups.

    Raises:
        ConfigError: If the file is not valid.
    """
    return validate(load_yaml(file), GroupsFile, Context(file.parent)).groups


def stages_of(group: str, file: Path) -> tuple[str, ...]:
    """Return the stages of a group.

    Raises:
        ConfigError: If the file is missing or not valid, or has no such group.
    """
    if not file.exists():
        raise _problem(file, "no such file: write the groups of this machine into it")
    groups = load_groups(file)
    if group not in groups:
        raise _problem(file, f"no group {group!r}, known: {', '.join(groups)}", "groups")
    return groups[group]


def _problem(file: Path, what: str, path: str = "") -> ConfigError:
    return ConfigError(Problem(str(file), 0, 0, path, what))
