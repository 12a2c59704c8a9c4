"""How results look when they are printed or shown in a notebook."""

from piezod.messages.answers import AxisStatus, Fault, Status


def status() -> Status:
    """Return the status of a stage with a fault and an axis without a command."""
    axis = AxisStatus(position_um=1.23456, command_um=None, drive_v=20.0)
    return Status(
        state="RUN",
        mode="adaptive",
        faults=(Fault(id="L2", name="late <often>"),),
        skipped_cycles=0,
        axes={"x": axis},
        stage="rig",
    )


def test_document_is_not_printed() -> None:
    """The printed form has each value once."""
    assert repr(status()).count("1.23456") == 1


def test_notebook_shows_a_table() -> None:
    """State, mode and faults are a line, the axes a table; signs of HTML are plain text."""
    shown = status()._repr_html_()

    assert "<p>rig: RUN, mode adaptive; faults: L2 late &lt;often&gt;</p>" in shown
    assert "<td>x</td><td>1.235</td><td>–</td><td>–</td><td>20.00</td><td>no</td>" in shown
