"""The table of the checks, in their order: most need what the ones before have left."""

from collections.abc import Callable
from functools import partial

from tests.vm.guest import buses, comedi, comedi_lines, iio, install, memory, others, service
from tests.vm.guest.host import Host


def checks(host: Host) -> tuple[tuple[str, Callable[[], str]], ...]:
    """Return the facts and the functions that check them."""
    return (
        ("install-service writes units that systemd accepts", install.service_is_installed),
        ("the unit starts, and the daemon reports that it is ready", service.unit_starts),
        ("the loop is real-time, with locked memory", service.loop_is_real_time),
        ("an engineer moves the stage", service.operator_moves),
        ("a clock that is set moves nothing", service.clock_is_set),
        ("the journal has structured messages", service.journal_has_fields),
        ("a full memory swaps out nothing of the loop", memory.loop_stays_in_memory),
        ("a hung supervisor is ended by the watchdog, at 0 V", service.watchdog_restarts),
        ("a killed supervisor starts again, at 0 V", service.kill_restarts),
        # From here on an emulated processor need not run this stage beside the others.
        ("`systemctl stop` ends at 0 V", service.stop_ends_at_rest),
        ("an amplifier behind a USB adapter is driven", partial(buses.usb_stage_drives, host)),
        ("the service opens the adapter and not the disk", buses.devices_are_restricted),
        ("the adapter is unplugged and plugged in again", partial(buses.usb_unplugged, host)),
        ("a node at the other CAN controller is driven", buses.can_stage_drives),
        ("the node's controller is taken down", buses.can_other_end_down),
        ("the stage's controller is taken down", buses.can_down),
        ("the stage's controller is removed", buses.can_removed),
        ("comedi: the card of the kernel is found", comedi.is_there),
        ("comedi: set-points are read back", comedi.setpoints_are_read_back),
        ("comedi: a table comes out value by value", comedi.play_comes_out),
        ("comedi: a record lacks no sample", comedi.record_is_complete),
        ("comedi: another program that drives it is named", comedi.other_program_is_named),
        ("comedi: a user without rights is told so", comedi.stranger_is_refused),
        ("comedi: wrong channels and ranges are refused", comedi.wrong_channels_are_refused),
        ("comedi: a stage drives at 20 Hz", comedi.stage_drives),
        ("comedi: the card is removed and comes back", comedi.card_is_removed),
        ("comedi: a stop ends at 0 V", comedi.stop_leaves_rest),
        ("comedi-lines: the parallel port is found", comedi_lines.is_there),
        ("comedi-lines: pulses reach the register", comedi_lines.pulses_reach_the_register),
        ("comedi-lines: edges are read", comedi_lines.edges_are_read),
        ("comedi-lines: wrong lines are refused", comedi_lines.wrong_lines_are_refused),
        ("iio: the chips of the kernel are found", iio.chips_are_there),
        ("iio: set-points reach the register", iio.setpoints_reach_the_register),
        ("iio: a user without rights is told so", iio.user_without_rights_is_told),
        ("iio: a wrong device or channel is named", iio.wrong_device_is_named),
        ("iio: a stage drives at 20 Hz", iio.stage_drives),
        ("iio: the chip is removed and comes back", iio.chip_is_removed),
        ("iio: a stop ends at 0 V", iio.stop_leaves_rest),
        ("the unit of the page serves it", others.page_is_served),
        ("the unit of the IOC serves the stages", others.ioc_serves),
        ("uninstall is refused while something runs", others.uninstall_is_refused),
        ("uninstall leaves nothing", others.uninstall_removes_all),
    )
