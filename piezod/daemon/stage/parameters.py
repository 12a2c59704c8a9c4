"""Saves the learned parameters of a stage, and loads them again."""

import asyncio
from collections.abc import Collection, Mapping
from datetime import UTC, datetime
from typing import NamedTuple

from pydantic import ValidationError

import piezod
from piezod.config.model_file import ModelFile
from piezod.control.stage.answer import Answer
from piezod.daemon.logging import logger
from piezod.daemon.stage.connection import LoopConnection
from piezod.daemon.stage.errors import NotNowError, StageError, UnknownNameError
from piezod.daemon.stores.parameter_document import AxisParameters
from piezod.daemon.stores.parameter_store import ParameterStore
from piezod.errors import DataError
from piezod.messages.requests import AdoptModel
from piezod.messages.stores import History, Loaded, Parameters, Saved
from piezod.telemetry.learned import LearnedAxis

_log = logger("parameters")


class _Kept(NamedTuple):
    """The parameters of a loop that has ended."""

    axes: Mapping[str, AxisParameters]  #: Parameters by name of the axis.
    file_models: Mapping[str, ModelFile | None]  #: Model of each axis in its configuration.
    lost: list[str]  #: What cannot be kept, for people.


class LearnedParameters:
    """Saves the parameters that the loop has learned, and loads saved ones into it."""

    def __init__(self, store: ParameterStore) -> None:
        self._store = store
        self._sequence: int | None = None
        self._kept: _Kept | None = None
        self.rejected = False
        """Whether saved parameters could not be used at the start; True until the loop knows it."""
        # The store is for one thread at a time, and weights must belong to the model in use.
        self._one_at_a_time = asyncio.Lock()

    async def now(self, loop: LoopConnection) -> Parameters:
        """Return the parameters in use, and the number under which they were saved or loaded."""
        async with self._one_at_a_time:
            found = await asyncio.to_thread(_in_use, loop)
        axes = {name: axis.model_dump(mode="json") for name, axis in found.items()}
        return Parameters(sequence=self._sequence, axes=axes)

    async def history(self) -> History:
        """Return the saved parameters, newest first."""
        async with self._one_at_a_time:
            stored = await asyncio.to_thread(self._store.history)
        return History(history=stored)

    async def save(self, loop: LoopConnection, who: str) -> Saved:
        """Save the parameters in use.

        Raises:
            NotNowError: If there are none yet, or they cannot be saved.
        """
        async with self._one_at_a_time:
            try:
                axes = await asyncio.to_thread(_in_use, loop)
                if not axes:
                    raise NotNowError("nothing has been learned yet", "wait until the loop runs")
                saved = await asyncio.to_thread(self._store.save, axes, who)
            except (DataError, OSError, ValidationError) as error:
                raise NotNowError(f"not saved: {error}", "older ones are kept") from error
        self._sequence = saved
        return Saved(saved)

    async def load(self, loop: LoopConnection, sequence: int | None) -> Loaded:
        """Load the parameters with a number, or the newest valid ones, into the loop.

        Raises:
            UnknownNameError: If there are none.
            NotNowError: If they belong to other axes, or the loop refuses them now.
        """
        async with self._one_at_a_time:
            loaded = await asyncio.to_thread(self._store.load, sequence)
        for each in loaded.rejected:
            _log.error("parameters rejected", file=each.file, why=each.why)
        if loaded.document is None:
            why = "; ".join(f"{each.file}: {each.why}" for each in loaded.rejected)
            details = {"rejected": loaded.rejected} if loaded.rejected else None
            nothing = "nothing is saved" + (f" as {sequence}" if sequence else "")
            raise UnknownNameError(why or nothing, "see `piezod params history`", details)
        _check_axes(loaded.document.axes, loop)  # all of them, before the first is changed
        for name, axis in loaded.document.axes.items():
            if axis.model is not None:  # an axis without a model has learned nothing
                request = AdoptModel(axis=name, model=axis.model, zero_um=axis.zero_um)
                answer = await self.adopt(loop, request)
                if not answer.accepted:
                    raise NotNowError(f"axis {name}: {answer.why}")
        self._sequence = loaded.document.sequence
        return Loaded(self._sequence, loaded.copy, loaded.rejected)

    async def keep(self, loop: LoopConnection, axes: Collection[str]) -> None:
        """Keep the parameters in use for the loop that a reload starts after this one.

        Args:
            loop: The loop.
            axes: The axes that keep them; those of the others lose their meaning.
        """
        async with self._one_at_a_time:
            self._kept = await asyncio.to_thread(_kept, loop, axes)

    async def restore(self, loop: LoopConnection) -> list[str]:
        """Let a loop that has just started begin with the kept parameters, or else the saved ones.

        Returns:
            What has been lost, and the remedy, for people; empty if nothing has.
        """
        kept, self._kept = self._kept, None
        if kept is None or not (kept.axes or kept.lost):
            return await self._restore_saved(loop)
        lost = [*kept.lost]
        for name, axis in kept.axes.items():
            # A model that was exchanged in the file replaces the learned one.
            new_model = loop.models[name] != kept.file_models[name]
            model = loop.models[name] if new_model else axis.model
            lost += await self._restore_axis(loop, name, model, axis.zero_um)
        for what in lost:
            _log.error("parameters lost at the reload", what=what)
        return lost

    async def _restore_axis(
        self, loop: LoopConnection, name: str, model: ModelFile | None, zero_um: float
    ) -> list[str]:
        """Restore one axis; return what has been lost."""
        if model is None:
            what = f"axis {name}: the sensor zero, because it has no model; `piezod zero` again"
            return [what] if zero_um else []
        try:
            answer = await self.adopt(loop, AdoptModel(axis=name, model=model, zero_um=zero_um))
        except StageError as error:
            answer = Answer(False, str(error))
        if answer.accepted:
            return []
        self.rejected = True
        return [f"axis {name}: {answer.why}; `piezod params load` loads the saved ones"]

    async def _restore_saved(self, loop: LoopConnection) -> list[str]:
        """Load the newest saved parameters, if there are any; return why they are not used."""
        try:
            loaded = await self.load(loop, None)
        except UnknownNameError as error:
            self.rejected = bool(error.details)
            return []  # nothing was saved, or `load` has logged the rejected files
        except StageError as error:
            self.rejected = True
            _log.error("saved parameters not loaded", why=str(error))
            return [f"the saved parameters: {error}"]
        self.rejected = bool(loaded.rejected)
        _log.info("saved parameters loaded", sequence=loaded.sequence)
        return []

    async def adopt(self, loop: LoopConnection, request: AdoptModel) -> Answer:
        """Let the loop use a model.

        No parameters are read meanwhile: they would mix the weights of one model with another one.
        """
        async with self._one_at_a_time:
            answer = await loop.requests.ask(request)
            if answer.accepted:
                # Only now: a refused model must not be saved with the weights of the present one.
                loop.models[request.axis or next(iter(loop.config.axes))] = request.model
        return answer


def _check_axes(stored: Mapping[str, AxisParameters], loop: LoopConnection) -> None:
    unknown = ", ".join(stored.keys() - set(loop.config.axes))
    if unknown:
        what = f"they belong to axes that this stage does not have: {unknown}"
        raise NotNowError(what, f"its axes are {', '.join(loop.config.axes)}")


def _in_use(loop: LoopConnection) -> dict[str, AxisParameters]:
    found = {name: _axis_in_use(loop, i) for i, name in enumerate(loop.config.axes)}
    return {name: axis for name, axis in found.items() if axis is not None}


def _axis_in_use(loop: LoopConnection, index: int) -> AxisParameters | None:
    """Return the parameters of one axis, None before they were first published.

    Raises:
        ValidationError: If they are beyond their ranges.
    """
    learned = loop.learned.read(index)
    if learned is None:
        return None
    return AxisParameters(
        model=_with_weights(loop.models[list(loop.config.axes)[index]], learned),
        zero_um=learned.zero_um,
        offset=learned.offset,
        scale=learned.scale,
    )


def _kept(loop: LoopConnection, kept: Collection[str]) -> _Kept:
    axes: dict[str, AxisParameters] = {}
    lost: list[str] = []
    for i, name in enumerate(loop.config.axes):
        if name not in kept:
            what = f"axis {name}: zero and weights, because its devices or its compensator changed"
            lost.append(f"{what}; `piezod zero` again")
            continue
        try:
            found = _axis_in_use(loop, i)
        except ValidationError as error:
            why = error.errors()[0]["msg"]
            lost.append(f"axis {name}: {why}; `piezod zero` and identify again")
            continue
        if found is not None:
            axes[name] = found
    return _Kept(axes, loop.file_models, lost)


def _with_weights(model: ModelFile | None, learned: LearnedAxis) -> ModelFile | None:
    """Return a model with the learned weights."""
    if model is None:
        return None
    return model.with_weights(learned.weights).model_copy(
        update={
            "created_at": datetime.now(UTC).isoformat(timespec="seconds"),
            "created_by": f"piezod {piezod.__version__}, learned in the loop",
        }
    )
