"""The keys of all configurations, from their pydantic models."""

from collections.abc import Iterable, Iterator
from typing import Final

from pydantic import BaseModel

from docs.site.reference.allowed import APART, allowed, anchor, default, models_in, title
from docs.site.reference.text import code, docstring, sentence, table
from piezod.config.daemon import DaemonConfig
from piezod.config.experiment import ExperimentConfig
from piezod.devices import registry

_HEAD: Final = ("key", "unit", "range", "default", "meaning")


def stage_page() -> Iterator[str]:
    """Return the lines of the page about the configuration of a stage."""
    explained = "[Running a stage](../stage.md#the-configuration)"
    return _page("a stage", "piezod run", explained, DaemonConfig)


def experiment_page() -> Iterator[str]:
    """Return the lines of the page about experiment files."""
    explained = "[Writing an experiment](../experiments.md)"
    return _page("an experiment", "piezod experiment", explained, ExperimentConfig)


def drivers_page() -> Iterator[str]:
    """Yield the page about the options of every driver."""
    yield "# Options of the drivers"
    yield ""
    yield "The keys of `options` of a device. `piezod drivers` lists the drivers."
    for name in registry.names():
        plugin = registry.load(name)
        yield f"\n## `{name}` {{ #driver-{name} }}\n"
        yield sentence(plugin.summary)
        yield ""
        first, *others = reachable(plugin.options_model)
        yield from _table(first, f"{name}-")
        for model in others:
            yield from _section(model, "###", f"{name}-")


def reachable(model: type[BaseModel]) -> list[type[BaseModel]]:
    """Return a model and all models of its keys, each once, in the order of the keys."""
    found = [model]
    for each in found:  # the list grows meanwhile
        for field in each.model_fields.values():
            inner = models_in(field.annotation)
            found += [one for one in inner if one not in APART and one not in found]
    return found


def _page(what: str, command: str, explained: str, model: type[BaseModel]) -> Iterator[str]:
    yield f"# Keys of {what}"
    yield ""
    yield f"The file that `{command}` takes. {explained} has"
    yield "the same keys with explanations; `piezod check FILE` checks a file."
    yield from _sections(model)


def _sections(model: type[BaseModel]) -> Iterator[str]:
    first, *others = reachable(model)
    yield "\n## The file\n"
    yield sentence(docstring(first).text.partition("\n\n")[0])
    yield from _table(first)
    for each in others:
        yield from _section(each, "##")


def _section(model: type[BaseModel], level: str, prefix: str = "") -> Iterator[str]:
    name = f"`kind: {title(model)}`" if "kind" in model.model_fields else title(model)
    yield f"\n{level} {name} {{ #{prefix}{anchor(model)} }}\n"
    yield sentence(docstring(model).text.partition("\n\n")[0])
    yield from _table(model, prefix)


def _table(model: type[BaseModel], prefix: str = "") -> Iterable[str]:
    rows = []
    for name, field in model.model_fields.items():
        may = allowed(field)
        text = may.text.replace("](#", f"](#{prefix}")
        meaning = field.description or ("selects this form" if name == "kind" else "")
        rows.append((code(name), may.unit, text, default(field), sentence(meaning)))
    return table(_HEAD, rows)
