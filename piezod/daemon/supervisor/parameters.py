"""Saves the learned parameters of a stage, and loads them again."""

import asyncio
from collections.abc import Collection, Mapping
from datetime import UTC, datetime
from typing import Any

from pydantic import ValidationError

import piezod
from piezod.config.model_file import ModelFile
from piezod.config.requests import AdoptModel
from piezod.control.stage.answer import Answer
from piezod.daemon.logging import logger
from piezod.daemon.service.stage_service import NotNowError, UnknownNameError
from piezod.daemon.stores.parameter_document import AxisParameters
from piezod.daemon.stores.parameter_store import ParameterStore
from piezod.daemon.supervisor.connection import LoopConnection
from piezod.errors import DataError
from piezod.telemetry.learned import LearnedAxis

Document = dict[str, Any]

_log = logger("parameters")


class LearnedParameters:
    """Saves the parameters that the loop has learned, and loads saved ones into it.

    Args:
        store: Stores them on the disk.
    """

    def __init__(self, store: ParameterStore) -> None:
        self._store = store
        self._sequence: int | None = None
        # The store is for one thread at a time, and weights must belong to the model in use.
        self._one_at_a_time = asyncio.Lock()

    async def now(self, loop: LoopConnection) -> Document:
        """Return the parameters in use, and the number under which they were saved or loaded."""
        async with self._one_at_a_time:
            found = await asyncio.to_thread(_in_use, loop)
        axes = {name: axis.model_dump(mode="json") for name, axis in found.items()}
        return {"sequence": self._sequence, "axes": axes}

    async def history(self) -> list[Document]:
        """Return the saved parameters, newest first."""
        async with self._one_at_a_time:
            stored = await asyncio.to_thread(self._store.history)
        return [{**each._asdict(), "axes": list(each.axes)} for each in stored]

    async def save(self, loop: LoopConnection, who: str) -> Document:
        """Save the parameters in use.

        Raises:
            NotNowError: If there are none yet, or they cannot be saved.
        """
        async with self._one_at_a_time:
            try:
                axes = await asyncio.to_thread(_in_use, loop)
                if not axes:
                    raise NotNowError("nothing has been learned yet", "wait until the loop runs")
                self._sequence = await asyncio.to_thread(self._store.save, axes, who)
            except (DataError, OSError, ValidationError) as error:
                raise NotNowError(f"not saved: {error}", "older ones are kept") from error
        return {"sequence": self._sequence}

    async def load(self, loop: LoopConnection, sequence: int | None) -> Document:
        """Load the parameters with a number, or the newest valid ones, into the loop.

        Raises:
            UnknownNameError: If there are none.
            NotNowError: If they belong to other axes, or the loop refuses them now.
        """
        async with self._one_at_a_time:
            loaded = await asyncio.to_thread(self._store.load, sequence)
        rejected = [each._asdict() for each in loaded.rejected]
        for each in loaded.rejected:
            _log.error("parameters rejected", file=each.file, why=each.why)
        if loaded.document is None:
            why = "; ".join(f"{each.file}: {each.why}" for each in loaded.rejected)
            raise UnknownNameError(why or "nothing is saved", "see `piezod params list`")
        _check_axes(loaded.document.axes, loop)  # all of them, before the first is changed
        for name, axis in loaded.document.axes.items():
            if axis.model is not None:  # an axis without a model has learned nothing
                request = AdoptModel(axis=name, model=axis.model, zero_um=axis.zero_um)
                answer = await self.adopt(loop, request)
                if not answer.accepted:
                    raise NotNowError(f"axis {name}: {answer.why}")
        self._sequence = loaded.document.sequence
        return {"sequence": self._sequence, "copy": loaded.copy, "rejected": rejected}

    async def carry(self, old: LoopConnection, new: LoopConnection, axes: Collection[str]) -> None:
        """Let a loop go on with what the loop before it has learned, saved or not.

        Args:
            old: The loop before, which has ended.
            new: The loop.
            axes: The axes whose parameters it takes over; those without a model have none.

        Raises:
            NotNowError: If the loop refuses them.
        """
        for name, axis in (await asyncio.to_thread(_in_use, old)).items():
            if name in axes and axis.model is not None:
                request = AdoptModel(axis=name, model=axis.model, zero_um=axis.zero_um)
                answer = await self.adopt(new, request)
                if not answer.accepted:
                    raise NotNowError(f"axis {name}: {answer.why}")

    async def adopt(self, loop: LoopConnection, request: AdoptModel) -> Answer:
        """Let the loop use a model.

        No parameters are read meanwhile: they would mix the weights of one model with another one.
        """
        async with self._one_at_a_time:
            answer = await loop.requests.ask(request)
            if answer.accepted:
                # Only now: a refused model must not be saved with the weights of the present one.
                loop.models[request.axis or loop.axes[0]] = request.model
        return answer


def _check_axes(stored: Mapping[str, AxisParameters], loop: LoopConnection) -> None:
    unknown = ", ".join(stored.keys() - set(loop.axes))
    if unknown:
        what = f"they belong to axes that this stage does not have: {unknown}"
        raise NotNowError(what, f"its axes are {', '.join(loop.axes)}")


def _in_use(loop: LoopConnection) -> dict[str, AxisParameters]:
    found = {}
    for i, name in enumerate(loop.axes):
        learned = loop.learned.read(i)
        if learned is not None:
            found[name] = AxisParameters(
                model=_with_weights(loop.models[name], learned),
                zero_um=learned.zero_um,
                offset=learned.offset,
                scale=learned.scale,
            )
    return found


def _with_weights(model: ModelFile | None, learned: LearnedAxis) -> ModelFile | None:
    """Return a model with the learned weights; the left weights come first in memory."""
    if model is None:
        return None
    weights = tuple(learned.weights.tolist())
    left = len(model.left_stop_thresholds)
    return model.model_copy(
        update={
            "left_stop_weights": weights[:left],
            "right_stop_weights": weights[left:],
            "created_at": datetime.now(UTC).isoformat(timespec="seconds"),
            "created_by": f"piezod {piezod.__version__}, learned in the loop",
        }
    )
