"""Plans and wrappers of plans for stages."""

import logging
from collections.abc import Callable, Coroutine
from typing import Any, Final

from bluesky import plan_stubs as bps
from bluesky import preprocessors as bpp
from bluesky.utils import Msg, MsgGenerator, RequestStop, root_ancestor

from piezod.bluesky.stage import PiezoStage
from piezod.errors import ClientError

_LOG: Final = logging.getLogger(__name__)


def hold_after_failure(plan: MsgGenerator[Any]) -> MsgGenerator[Any]:
    """Hold all stages that a plan has used, if it is aborted or fails.

    For all plans of a RunEngine: `RE.preprocessors.append(hold_after_failure)`. Without it only a
    stage that moves is held. The next plan resumes them.
    """
    used: list[PiezoStage] = []

    def note(msg: Msg) -> Msg:
        device = None if msg.obj is None else root_ancestor(msg.obj)
        if isinstance(device, PiezoStage) and device not in used:
            used.append(device)
            device.link.commanded = False
        return msg

    def hold(error: Exception) -> MsgGenerator[None]:
        commanded = [each for each in used if each.link.commanded]
        if commanded and not isinstance(error, RequestStop):
            yield from bps.wait_for([_holding(each) for each in commanded])

    return (yield from bpp.contingency_wrapper(bpp.msg_mutator(plan, note), except_plan=hold))


def _holding(stage: PiezoStage) -> Callable[[], Coroutine[Any, Any, None]]:
    async def hold() -> None:
        try:
            await stage.hold()
        except ClientError:  # the other stages are to be held all the same
            _LOG.exception("%s cannot be held", stage.name)

    return hold
