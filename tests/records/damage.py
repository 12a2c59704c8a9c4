"""Makes damaged and hostile files of a good recording; a seed decides what is done to it."""

import random
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np

ODD: Final[Sequence[Any]] = (
    0, -1, 255, 2**40, -(2**62), float("nan"), float("inf"), -1e300, "", "text", b"\xff\xfe",
    np.arange(3), np.empty(0), ["a", "b"], "x" * 3000, True,
)  # fmt: skip
TEXTS: Final = (
    "", "[]", "null", "{", "7", '{"axes": [], "devices": {}}', '{"axes": {"x": 1}, "devices": {}}',
    '{"axes": {"x": {}}, "devices": {"rig": []}}', "[" * 5000, "delay_s: .nan\n", "delay_s: [1]\n",
    "a: &a [*a]\n", "\x00",
)  # fmt: skip


def damage(path: Path, seed: int) -> str:
    """Do one thing to a recording; return what, for the message of a test."""
    chosen = random.Random(seed)  # noqa: S311 - the same damage each time
    with h5py.File(path, "r+", libver="v110") as file:
        groups: list[h5py.Group] = [file["recording"]]
        datasets: list[h5py.Dataset] = []
        file["recording"].visititems(
            lambda _, each: (groups if isinstance(each, h5py.Group) else datasets).append(each)
        )
        kind = chosen.choice((_value, _value, _shape, _shape, _attribute, _attribute, _gone, _text))
        return f"{kind.__name__}: {kind(chosen, groups, datasets)}"


def _value(chosen: random.Random, _: list[h5py.Group], datasets: list[h5py.Dataset]) -> str:
    dataset = chosen.choice([each for each in datasets if each.ndim and each.dtype.kind in "biuf"])
    if not dataset.size:
        return "nothing"
    place = tuple(chosen.randrange(length) for length in dataset.shape)
    odd = chosen.choice((0, -1, 255, 2**40, -(2**62), float("nan"), float("inf"), -1e300))
    with np.errstate(all="ignore"):
        whole = odd if isinstance(odd, int) else 0
        values = dataset[()]
        if values.dtype.kind == "f":
            values[place] = odd
        else:
            bits = 8 * values.dtype.itemsize
            values.view(f"u{values.dtype.itemsize}")[place] = whole % 2**bits
        dataset[()] = values
    return f"{dataset.name}{place} = {odd}"


def _shape(chosen: random.Random, _: list[h5py.Group], datasets: list[h5py.Dataset]) -> str:
    dataset = chosen.choice(datasets)
    name, parent = dataset.name, dataset.parent
    values, attributes = dataset[()], dict(dataset.attrs)
    rows = np.atleast_1d(values)
    made: Sequence[Callable[[], Any]] = (
        lambda: rows[: rows.shape[0] // 2],
        lambda: rows[:0],
        lambda: rows[None, :],
        lambda: rows[:, None],
        rows.tobytes()[:100].hex,
        lambda: np.zeros(rows.shape, "c16"),
        lambda: np.zeros(rows.shape, "f4"),
        lambda: np.full(rows.shape, 255, "u1"),
        lambda: np.zeros(rows.shape, [("a", "i4"), ("b", "f8")]),
        lambda: h5py.Empty("f8"),
        lambda: 7,
    )
    number = chosen.randrange(len(made))
    base = name.rpartition("/")[2]
    del parent[base]
    parent[base] = made[number]()
    for key, value in attributes.items():
        parent[base].attrs[key] = value
    return f"{name} {number}"


def _attribute(chosen: random.Random, groups: list[h5py.Group], _: list[h5py.Dataset]) -> str:
    group = chosen.choice([each for each in (groups[0], *groups) if len(each.attrs)])
    name = chosen.choice(sorted(group.attrs))
    odd = chosen.choice(ODD)
    group.attrs[name] = odd
    return f"{group.name}@{name} = {odd!r:.40}"


def _gone(chosen: random.Random, groups: list[h5py.Group], datasets: list[h5py.Dataset]) -> str:
    item = chosen.choice([*groups[1:], *datasets])
    name = item.name
    if chosen.random() < 0.3 and len(item.attrs):
        key = chosen.choice(sorted(item.attrs))
        del item.attrs[key]
        return f"{name}@{key}"
    parent, base = item.parent, name.rpartition("/")[2]
    del parent[base]
    if chosen.random() < 0.5:
        parent[base] = chosen.choice((h5py.SoftLink("/nowhere"), h5py.SoftLink("/recording")))
    return str(name)


def _text(chosen: random.Random, groups: list[h5py.Group], _: list[h5py.Dataset]) -> str:
    notes = [each for each in groups if each.attrs.get("NX_class") == "NXnote"]
    note, text = chosen.choice(notes), chosen.choice(TEXTS)
    if "data" in note:
        del note["data"]
    note["data"] = text.replace("\x00", "?")
    return f"{note.name} = {text[:40]!r}"
