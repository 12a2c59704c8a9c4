import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.errors import DataError
from piezod.reading.checks import MAX_STEP_PERIODS
from piezod.reading.choices import TRAJECTORY
from piezod.reading.record import MIN_SAMPLES, read_record
from piezod.reading.table import FloatArray
from piezod.records.csv_file import write_csv

HEADER = "t_s,drive_v,position_um"


def _rows(n_rows: int = 120) -> list[str]:
    return [f"{i / 1000},{i % 7}.5,{i % 5}" for i in range(n_rows)]


def _write(path: Path, rows: list[str], header: str = HEADER, end: str = "\n") -> Path:
    path.write_bytes((end.join([header, *rows]) + end).encode())
    return path


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return the path of the file that a test writes."""
    return tmp_path / "run.csv"


def _columns(path: Path) -> dict[str, FloatArray]:
    """Return the columns of a file of which nothing had to be inferred."""
    record = read_record(path)
    assert record.understood == ()
    return record.columns


def _refusal(path: Path) -> str:
    with pytest.raises(DataError) as caught:
        read_record(path)
    return str(caught.value).removeprefix(f"{path}:")


def test_columns_come_back_by_name(file: Path) -> None:
    """A valid file gives its required columns as float64, in the requested order."""
    columns = _columns(_write(file, _rows()))

    assert list(columns) == ["t_s", "drive_v", "position_um"]
    assert columns["t_s"].dtype == np.float64
    assert np.array_equal(columns["t_s"], np.arange(120) / 1000)
    assert np.array_equal(columns["position_um"], np.arange(120) % 5)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_line_ends_and_byte_order_mark_do_not_matter(file: Path, end: str, mark: str) -> None:
    """Files from Windows and old Macs, with or without a byte order mark, give the same data."""
    columns = _columns(_write(file, _rows(), mark + HEADER, end))

    assert columns["drive_v"].size == 120


def test_spaces_and_trailing_blank_lines_do_not_matter(file: Path) -> None:
    """Spaces round names and numbers, and blank lines at the end, are accepted."""
    rows = [row.replace(",", " , ") for row in _rows()]

    assert (
        _columns(_write(file, [*rows, "", " ", ""], " t_s, drive_v ,position_um"))["t_s"].size
        == 120
    )


def test_columns_that_are_not_required_are_not_read(file: Path) -> None:
    """A column of remarks is ignored, whatever its content."""
    rows = [f"{row},µ-remark" for row in _rows()]

    assert list(_columns(_write(file, rows, HEADER + ",remark"))) == HEADER.split(",")


@pytest.mark.parametrize(
    ("field", "said"),
    [
        (
            "abc",
            "drive_v is 'abc'; allowed is a number such as -1.25e-3; correct or delete the row",
        ),
        (
            "1_0",
            "drive_v is '1_0'; allowed is a number such as -1.25e-3; correct or delete the row",
        ),
        (
            "-inf",
            "drive_v is -inf; allowed is any finite number; "
            "cut the record there, or fill in the measured value",
        ),
        (
            "1e999",
            "drive_v is inf; allowed is any finite number; "
            "cut the record there, or fill in the measured value",
        ),
    ],
)
@pytest.mark.parametrize("index", [0, 1, 63, 64, 118, 119])
def test_first_bad_value_is_named_with_its_line(
    file: Path, index: int, field: str, said: str
) -> None:
    """A value that is not finite is refused with the line of its first appearance."""
    rows = _rows()
    rows[index] = f"{index / 1000},{field},0"
    rows[-1] = f"0.119,{field},0"

    assert _refusal(_write(file, rows)) == f"{index + 2}: {said}"


@pytest.mark.parametrize("field", ["", "NaN", "n/a", "-", '""'])
def test_rows_with_empty_cells_are_left_out(file: Path, field: str) -> None:
    """A cell without a value makes its row missing, which is a gap; the lines stay those of it."""
    rows = _rows()
    rows[50] = f"0.05,{field},1"
    record = read_record(_write(file, rows), max_step_periods=2.5)

    assert record.columns["t_s"].tolist() == [i / 1000 for i in range(120) if i != 50]
    assert record.place(50) == f"{file}:53"
    assert _refusal(file).startswith("53: a gap of 0.002 s before t_s 0.051;")


def test_words_in_place_of_numbers_are_refused(file: Path) -> None:
    """A file without a column of numbers is no record."""
    assert _refusal(_write(file, ["a,b,c"] * 120)).startswith("1: there are no rows of numbers;")


@pytest.mark.parametrize(
    ("row", "n_fields"),
    [("0.05,1", 2), ("0.05,1,2,3", 4), ("0,05,1,2", 4), ("", 0), ("  ", 0), ("5", 1)],
)
def test_ragged_rows_are_named(file: Path, row: str, n_fields: int) -> None:
    """A row with too few or too many fields, and a blank one, is refused with its line."""
    rows = _rows()
    rows[50] = row

    assert _refusal(_write(file, rows)) == (
        f"52: the row has {n_fields} field{'s' * (n_fields != 1)}; allowed are 3 as in the other "
        "rows; complete or delete the row"
    )


@pytest.mark.parametrize("text", ["", "\n\n", "\ufeff", "  \n"])
def test_empty_file_is_refused(file: Path, text: str) -> None:
    """A file without a header is refused as empty."""
    file.write_text(text, encoding="utf-8")

    assert _refusal(file).startswith("1: the file is empty; allowed is a header and samples;")


@pytest.mark.parametrize("row", [60, 60_000])
def test_text_in_windows_encoding_is_read(file: Path, row: int) -> None:
    """A remark that is not UTF-8, wherever it is, is text of Windows."""
    rows = [f"{text},ok" for text in _rows(70_000)]
    rows[row] = rows[row].replace("ok", "bei 21 \N{DEGREE SIGN}C")
    file.write_bytes("\n".join([HEADER + ",remark", *rows]).encode("cp1252"))

    record = read_record(file)
    assert record.columns["t_s"].size == 70_000
    assert "CP1252" in record.understood[0]


@pytest.mark.parametrize("n_rows", [1, MIN_SAMPLES - 1])
def test_too_short_is_refused(file: Path, n_rows: int) -> None:
    """A record with too few samples is refused."""
    assert _refusal(_write(file, _rows(n_rows))) == (
        f"{n_rows + 1}: the file ends after {n_rows} sample{'s' * (n_rows != 1)}; "
        "allowed are 100 or more; "
        "record for longer"
    )


def test_least_number_of_samples_is_enough(file: Path) -> None:
    """A record with the smallest number of samples is read, and the caller may allow fewer."""
    assert _columns(_write(file, _rows(MIN_SAMPLES)))["t_s"].size == MIN_SAMPLES
    assert read_record(_write(file, _rows(2)), min_samples=2).columns["t_s"].size == 2


@pytest.mark.parametrize("name", ["drive_v", "position_um"])
def test_constant_signal_is_refused(file: Path, name: str) -> None:
    """A drive or a displacement that never changes is refused."""
    index = HEADER.split(",").index(name)
    rows = [
        ",".join("2.5" if i == index else text for i, text in enumerate(row.split(",")))
        for row in _rows()
    ]

    assert _refusal(_write(file, rows)) == (
        f"2: {name} is 2.5 in all 120 samples; allowed is a signal that varies; "
        "check the cable and the channel, and record again"
    )


def test_time_going_back_is_refused(file: Path) -> None:
    """Unsorted time is refused with the first line that comes too early."""
    rows = _rows()
    rows[30], rows[31] = rows[31], rows[30]

    assert _refusal(_write(file, rows)) == (
        "33: t_s 0.03 comes after 0.031; allowed is time that rises; "
        "sort the rows by time, delete double rows, or write t_s with more digits"
    )


def test_time_standing_still_is_refused(file: Path) -> None:
    """A repeated time is refused."""
    rows = _rows()
    rows.insert(31, rows[30])

    assert _refusal(_write(file, rows)).startswith("33: t_s 0.03 repeats 0.03; allowed is time")


def test_quoted_fields_are_read(file: Path) -> None:
    """Fields in quotation marks, as some programs write them, are the numbers inside."""
    rows = [",".join(f'"{field}"' for field in row.split(",")) for row in _rows()]
    header = ",".join(f'"{name}"' for name in HEADER.split(","))
    plain = _columns(_write(file, _rows()))

    quoted = _columns(_write(file, rows, header))
    assert {name: column.tolist() for name, column in quoted.items()} == {
        name: column.tolist() for name, column in plain.items()
    }


def test_gap_is_refused(file: Path) -> None:
    """A missing row is refused with the line after the gap, its length, and the number of gaps."""
    rows = _rows()
    del rows[80], rows[40]

    assert _refusal(_write(file, rows)) == (
        "42: a gap of 0.002 s before t_s 0.041; allowed are 0.0015 s, 1.5 times the median step; "
        "2 such gaps in the file; cut the record there, or resample it"
    )


@pytest.mark.parametrize(
    ("step", "accepted"), [(0.5, True), (1.0, True), (1.499, True), (1.501, False), (3.0, False)]
)
def test_jitter_is_accepted_up_to_the_gap(file: Path, step: float, accepted: bool) -> None:
    """A time step below 1.5 median steps is jitter; a longer one is a gap."""
    t_s = np.arange(200.0)
    t_s[100:] += step - 1
    columns = {"t_s": t_s, "drive_v": t_s, "position_um": t_s}
    write_csv(file, columns)

    if accepted:
        assert np.array_equal(_columns(file)["t_s"], t_s)
    else:
        assert "a gap of" in _refusal(file)
    assert MAX_STEP_PERIODS == 1.5


def test_missing_file_is_an_os_error(tmp_path: Path) -> None:
    """A missing file raises the error of opening it."""
    with pytest.raises(FileNotFoundError):
        read_record(tmp_path / "absent.csv")


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=40))
def test_numbers_come_back_to_the_last_bit(
    tmp_path_factory: pytest.TempPathFactory, values: list[float]
) -> None:
    """Any finite double survives writing and reading, including the sign of zero."""
    file = tmp_path_factory.mktemp("round_trip") / "run.csv"
    command_um = np.array(values)

    write_csv(file, {"t_s": np.arange(command_um.size), "command_um": command_um})
    read = read_record(file, roles=TRAJECTORY, min_samples=1).columns["command_um"]

    assert read.tobytes() == command_um.tobytes()


@given(data=st.data())
def test_any_single_damage_is_refused_with_its_line(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """If any field of a valid file is replaced by junk, the message names its line."""
    file = tmp_path_factory.mktemp("damage") / "run.csv"
    rows = _rows()
    index = data.draw(st.integers(0, len(rows) - 1))
    column = data.draw(st.integers(0, 2))
    junk = data.draw(st.sampled_from(["x", "Infinity", "1e", "--1", "0x1", "1 2", "٣"]))
    fields = rows[index].split(",")
    fields[column] = junk
    rows[index] = ",".join(fields)

    assert _refusal(_write(file, rows)).startswith(f"{index + 2}: {HEADER.split(',')[column]} is ")


def test_large_file_with_one_bad_value(file: Path) -> None:
    """In a file of 200 000 rows the line of the one bad value is found."""
    rows = _rows(200_000)
    rows[170_000] = "170.0,1.5,oops"

    assert _refusal(_write(file, rows)).startswith("170002: position_um is 'oops';")


def test_columns_of_different_length_are_not_written(file: Path) -> None:
    """Writing columns of different lengths raises and leaves no file behind."""
    columns = {"a": np.zeros(2), "b": np.zeros(3)}

    with pytest.raises(ValueError, match="argument 2 is longer"):
        write_csv(file, columns)
    assert list(file.parent.iterdir()) == []


def test_recorded_data_of_a_lab_is_read(shared_data: Path) -> None:
    """The recorded identification run of a real stage passes every check."""
    columns = _columns(shared_data / "data" / "ntu_p885" / "identification.csv")

    assert columns["t_s"].size == 8027
    assert np.median(np.diff(columns["t_s"])) == pytest.approx(0.005)


def test_reading_csv_brings_neither_matplotlib_nor_h5py() -> None:
    """Importing the CSV module imports neither of them."""
    code = (
        "import sys, piezod.reading.record, piezod.reading.text\n"
        "print(sorted({'matplotlib', 'h5py', 'scipy'} & set(sys.modules)))"
    )

    printed = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout

    assert printed == "[]\n"
