"""The learned parameters of a stage: saved, loaded, and kept across an exchange of the loop."""

import asyncio
from pathlib import Path

import numpy as np
import pytest

from piezod.config.daemon import DaemonConfig
from piezod.config.faults import Fault
from piezod.config.states import State
from piezod.control.faults.table import mask
from piezod.control.stage.answer import Answer
from piezod.daemon.stage.errors import NotNowError, UnknownNameError
from piezod.messages.requests import (
    AdoptModel,
)
from piezod.telemetry.learned_writer import LearnedWriter
from tests.control.surface_rig import surface_file
from tests.daemon.bench import PEER, Bench


def _learn(bench: Bench, zero_um: float) -> list[float]:
    model = bench.loop.models["x"]
    assert model is not None
    weights = [1.01 * each for each in (*model.left_stop_weights, *model.right_stop_weights)]
    LearnedWriter(bench.loop.shared).publish(0, (weights, 0.0, 0.0, zero_um, False, 0.0, 0.0, 26.0))
    return weights


def test_saved_parameters_are_loaded(bench: Bench) -> None:
    """The learned weights become a model again, with the sensor zero."""
    weights = _learn(bench, zero_um=0.25)
    saved = bench.do(lambda link: link.save_params(PEER))
    history = bench.do(lambda link: link.params_history())
    loaded = bench.do(lambda link: link.load_params(None, PEER))

    (request,) = bench.requests
    assert isinstance(request, AdoptModel)
    assert request.zero_um == 0.25
    assert saved.sequence == loaded.sequence == 1
    assert [entry.saved_by for entry in history.history] == ["somebody"]
    model = bench.loop.models["x"]
    assert model is not None
    assert [*model.left_stop_weights, *model.right_stop_weights] == pytest.approx(weights)
    assert asyncio.run(bench.link.params()).axes["x"]["zero_um"] == 0.25


def test_parameters_beyond_their_range_are_not_saved(bench: Bench) -> None:
    """Parameters that could not be loaded again are refused, and older ones stay."""
    _learn(bench, zero_um=1e9)

    with pytest.raises(NotNowError, match=r"not saved: (?s:.*)zero_um"):
        bench.do(lambda link: link.save_params(PEER))


def test_parameters_that_the_loop_refuses_are_not_in_use(bench: Bench) -> None:
    """The client gets the reason of the loop."""
    _learn(bench, zero_um=0.0)
    bench.do(lambda link: link.save_params(PEER))
    before = bench.loop.models["x"]

    with pytest.raises(NotNowError, match="axis x: only while disarmed"):
        bench.do(lambda link: link.load_params(1, PEER), Answer(False, "only while disarmed"))

    assert bench.loop.models["x"] is before


@pytest.mark.fault("D8")
@pytest.mark.parametrize("damaged", [1, 2])
def test_damaged_parameters_are_a_fault_at_the_start(bench: Bench, damaged: int) -> None:
    """D8 is reported until the loop has latched it, whether or not an older file can be used."""
    _learn(bench, zero_um=0.25)
    for _ in range(2):
        bench.do(lambda link: link.save_params(PEER))
    for path in sorted(bench.paths.parameters.glob("*.json"))[-damaged:]:
        path.write_bytes(path.read_bytes()[:-9])

    bench.do(lambda link: link.restore_params())
    before = bench.reported()
    bench.record(State.SAFE, latched=mask([Fault.D8]))

    assert (before, bench.reported()) == ([Fault.D8], [])
    assert len(bench.requests) == 2 - damaged


@pytest.mark.fault("D8")
def test_parameters_that_the_loop_refuses_at_the_start_are_a_fault(bench: Bench) -> None:
    """The stage does not adapt from another model than the saved one without a word."""
    _learn(bench, zero_um=0.25)
    bench.do(lambda link: link.save_params(PEER))

    lost = bench.do(lambda link: link.restore_params(), Answer(False, "its gain is not safe"))

    assert lost == ["the saved parameters: axis x: its gain is not safe"]
    assert bench.reported() == [Fault.D8]


def test_no_parameters_at_the_start_are_no_fault(bench: Bench) -> None:
    """A stage whose parameters were never saved begins with the models of its configuration."""
    assert bench.do(lambda link: link.restore_params()) == []
    assert bench.reported() == []
    assert bench.requests == []


class Exchange:
    """A bench whose loop is exchanged for another one."""

    def __init__(
        self, bench: Bench, *, model_changed: bool = False, answer: Answer | None = None
    ) -> None:
        old = bench.loop
        asyncio.run(bench.link.parameters.keep(old, old.axes))
        bench.loop = bench.link.loop = bench.connection()
        if model_changed:
            model = old.file_models["x"]
            assert model is not None
            bench.loop.models["x"] = model.model_copy(update={"created_by": "another fit"})
        assert bench.loop.models["x"] is not None
        self.file_model = bench.loop.models["x"]
        self.lost = bench.do(lambda link: link.restore_params(), answer)
        self.requests = bench.requests


def test_parameters_outlive_an_exchange(bench: Bench) -> None:
    """The new loop begins with the zero and the weights in use, not with the saved ones."""
    _learn(bench, zero_um=0.0)
    bench.do(lambda link: link.save_params(PEER))
    weights = _learn(bench, zero_um=0.25)
    exchange = Exchange(bench)

    (request,) = exchange.requests
    assert isinstance(request, AdoptModel)
    model = request.model
    assert [*model.left_stop_weights, *model.right_stop_weights] == pytest.approx(weights)
    assert (request.zero_um, exchange.lost) == (0.25, [])


def test_model_that_was_exchanged_in_the_file_replaces_the_learned_one(bench: Bench) -> None:
    """The sensor zero stays, because it is not part of the model."""
    _learn(bench, zero_um=0.25)
    exchange = Exchange(bench, model_changed=True)

    assert exchange.requests == [AdoptModel(axis="x", model=exchange.file_model, zero_um=0.25)]


def test_zero_of_an_axis_without_a_model_is_reported_lost(bench: Bench) -> None:
    """The answer to the reload says what has to be done again."""
    bench.loop.models["x"] = bench.loop.file_models["x"] = None
    LearnedWriter(bench.loop.shared).publish(0, (np.ones(4), 0.0, 0.0, 0.25, False, 0.0, 0.0, 26.0))
    asyncio.run(bench.link.parameters.keep(bench.loop, {"x"}))

    lost = bench.do(lambda link: link.restore_params())

    assert lost == ["axis x: the sensor zero, because it has no model; `piezod zero` again"]


@pytest.mark.fault("D8")
def test_parameters_that_the_new_loop_refuses_are_reported_lost(bench: Bench) -> None:
    """They are named in the answer, and the stage has a fault that forbids adaptation."""
    _learn(bench, zero_um=0.25)
    exchange = Exchange(bench, answer=Answer(False, "its gain is not safe"))

    remedy = "`piezod params load` loads the saved ones"
    assert exchange.lost == [f"axis x: its gain is not safe; {remedy}"]
    assert bench.reported() == [Fault.D8]


def test_parameters_of_other_axes_are_refused(tmp_path: Path, config: DaemonConfig) -> None:
    """A rebuilt stage may have other axes under the same name."""
    before = Bench(tmp_path, config.model_copy(update={"axes": {"y": config.axes["x"]}}))
    weights = np.ones(4)
    before.loop.models["y"] = None
    LearnedWriter(before.loop.shared).publish(0, (weights, 0.0, 0.0, 0.0, False, 0.0, 0.0, 26.0))
    before.do(lambda link: link.save_params(PEER))
    before.link.stage_audit.close()
    bench = Bench(tmp_path, config)

    with pytest.raises(NotNowError, match="axes that this stage does not have: y"):
        bench.do(lambda link: link.load_params(None, PEER))
    bench.link.stage_audit.close()


def test_number_that_was_never_saved_is_no_damaged_file(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    """The client gets the number; nothing is logged, because no file is damaged."""
    _learn(bench, zero_um=0.0)
    bench.do(lambda link: link.save_params(PEER))

    with pytest.raises(UnknownNameError, match="nothing is saved as 999") as raised:
        bench.do(lambda link: link.load_params(999, PEER))

    assert raised.value.details == {}
    assert "rejected" not in capsys.readouterr().err


def test_missing_parameters_are_an_error(bench: Bench) -> None:
    """Nothing can be loaded before the first save, nor saved before the first cycle."""
    with pytest.raises(UnknownNameError, match="nothing is saved"):
        bench.do(lambda link: link.load_params(None, PEER))
    with pytest.raises(NotNowError, match="nothing has been learned"):
        bench.do(lambda link: link.save_params(PEER))


def test_adopted_model_is_the_one_to_save(bench: Bench) -> None:
    """Weights learned later belong to the thresholds of the adopted model."""
    model = bench.loop.models["x"]
    assert model is not None
    other = model.model_copy(update={"created_by": "somebody else"})
    bench.do(lambda link: link.request(AdoptModel(model=other), PEER))

    assert bench.loop.models["x"] == other


def test_parameters_of_exchanged_devices_are_reported_lost(bench: Bench) -> None:
    """Zero and weights belong to the devices."""
    _learn(bench, zero_um=0.25)
    asyncio.run(bench.link.parameters.keep(bench.loop, set()))

    (lost,) = bench.do(lambda link: link.restore_params())

    assert lost.startswith("axis x: zero and weights, because its devices")
    assert bench.requests == []


def test_learned_surface_is_saved_and_loaded(bench: Bench) -> None:
    """A surface is adopted through the link; its learned coefficients become a model again."""
    surface = surface_file()
    adopted = bench.do(lambda link: link.request(AdoptModel(axis="x", model=surface), PEER))
    learned = [1.01 * each for each in surface.surface_coefficients]
    LearnedWriter(bench.loop.shared).publish(0, (learned, 0.0, 0.0, 0.25, False, 0.0, 0.0, 26.0))

    bench.do(lambda link: link.save_params(PEER))
    bench.do(lambda link: link.load_params(None, PEER))

    (request,) = bench.requests
    assert adopted.accepted
    assert isinstance(request, AdoptModel)
    assert request.model.version == 2
    assert request.model.surface_coefficients == tuple(learned)
    assert request.model.left_stop_weights == request.model.right_stop_weights == ()
