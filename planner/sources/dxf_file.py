"""A DXF file as ezdxf reads it: its entities in model space, the layers that count, and its unit."""

import re
from collections import Counter, defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kinematics.errors import Fault, FileError, MotionError
from kinematics.registry import nearest
from kinematics.units import shown
from planner.sources.dxf_lines import line_of
from planner.sources.faults import Faults
from planner.sources.texts import bytes_of

if TYPE_CHECKING:
    from planner.sources.dxf import Dxf

METRES = {
    1: 0.0254, 2: 0.3048, 3: 1609.344, 4: 1e-3, 5: 1e-2, 6: 1.0, 7: 1e3, 8: 25.4e-9, 9: 25.4e-6, 10: 0.9144,
    13: 1e-6, 14: 0.1, 15: 10.0, 16: 100.0,
}  # fmt: skip
"""m of the units that $INSUNITS can name."""
LAST_CODE = 24
HANDLE, VARIABLE = 5, 9
"""Group codes."""
HANDLES = 1000
"""Entities of a kind and layer that are named one by one."""


@dataclass(frozen=True, slots=True)
class Drawing:
    """Its entities, in their order; m of its unit; and what its user has to know."""

    entities: list[Any]
    metres: float
    warnings: list[str]


def drawing(path: Path, options: "Dxf") -> Drawing:
    """Raises FileError for what is no DXF file, is broken or has no unit; MotionError where ezdxf is not there."""
    try:
        from ezdxf.filemanagement import readfile
    except ImportError:
        raise MotionError('DXF files need ezdxf; install it with: pip install "pulsepath[cad]"') from None
    raw = bytes_of(path)
    try:
        document = readfile(path)
        entities = list(document.modelspace())
        layers = {layer.dxf.name.lower(): layer for layer in document.layers}
        papers = Counter(
            {name: len(document.layout(name)) for name in document.layout_names() if name.lower() != "model"}
        )
    except Exception as error:  # whatever its parser comes upon
        told = str(error).removeprefix(f"{type(error).__name__}: ").replace(str(path), "it").replace("File 'it'", "it")
        line = int(at[1]) if (at := re.search(r"near line: (\d+)", told)) else raw.count(b"\n") if raw else 1
        more = "" if told.endswith("is not a DXF file.") else "; what follows is not looked at"
        message = f"not a DXF file that can be read: {shown(told)}{more}"
        raise FileError(str(path), [Fault("", message, line if more else 1)]) from None
    warnings = [f"{count} entities of layout {shown(name)} are not read" for name, count in papers.items() if count]
    metres = _metres(path, document.units if b"$INSUNITS" in raw else 0, options.length, warnings)
    taken = _taken(path, entities, layers, options, warnings)
    return Drawing(taken, metres, warnings)


def _metres(path: Path, code: int, length: str | None, warnings: list[str]) -> float:
    """ezdxf takes metres where a file says nothing: so whether it says something is asked of the file itself."""
    from kinematics.units import unit_value

    said = METRES.get(code)
    if length is None:
        if said is None:
            told = "states no unit ($INSUNITS)" if not code else f"states unit {code} ($INSUNITS), which is not known"
            line = line_of(path, VARIABLE, "$INSUNITS") or 1
            told = f'the drawing {told}; give the option length, e.g. "mm"'
            raise FileError(str(path), [Fault("$INSUNITS", told, line)])
        return said
    given = unit_value(length, "m")
    if said is not None and said != given:
        warnings.append(f"the drawing states units of {said * 1e3:g} mm; {length} was taken, as the option says")
    return given


def _taken(path: Path, entities: list[Any], layers: dict[str, Any], options: "Dxf", warnings: list[str]) -> list[Any]:
    """Those of the layers that count: named ones, or all but skipped and hidden ones."""
    named, skipped = options.named, options.skipped
    known = layers.keys() | {layer_of(entity).lower() for entity in entities}
    for name in [*named, *skipped]:
        if name not in known:
            offered = ", ".join(shown(layer) for layer in sorted(known)[:20])
            raise FileError(str(path), [Fault("", f'no layer "{name}"{nearest(name, known)}; its layers: {offered}')])
    hidden = {name for name, layer in layers.items() if layer.is_off() or layer.is_frozen()} - set(named)
    left, taken = Counter[str](), []
    for entity in entities:
        layer = layer_of(entity).lower()
        if (named and layer not in named) or layer in skipped:
            left[f"on layer {shown(layer_of(entity))}, as the options say"] += 1
        elif layer in hidden:
            left[f"on layer {shown(layer_of(entity))}, which is off or frozen"] += 1
        elif entity.dxf.hasattr("invisible") and entity.dxf.invisible:
            left["that are invisible"] += 1
        else:
            taken.append(entity)
    warnings += [f"{count} entities {why} were left out" for why, count in left.items()]
    return taken


def layer_of(entity: Any) -> str:
    """Its layer; of kinds that ezdxf does not know too."""
    return str(entity.dxf.layer if entity.dxf.hasattr("layer") else entity.graphic_properties().get("layer", "0"))


def refuse_unknown(path: Path, entities: list[Any], faults: Faults) -> None:
    """One fault for each kind and layer of entities that are not supported: line of the first, handles of them all."""
    groups = defaultdict(list)
    for entity in entities:
        groups[entity.dxftype(), layer_of(entity)].append(str(entity.dxf.handle))
    for (kind, layer), handles in groups.items():
        more = f" and {len(handles) - HANDLES} more" if len(handles) > HANDLES else ""
        remedy = "explode it" if kind in ("INSERT", "DIMENSION", "MLINE", "POLYLINE") else "take it out"
        faults.add(
            f"{kind} is not supported: {remedy}, or skip its layer; handle{'s' * (len(handles) > 1)} "
            f"{', '.join(handles[:HANDLES])}{more}",
            line_of(path, HANDLE, handles[0]),
            f"layer {shown(layer)}",
        )
