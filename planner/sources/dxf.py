"""DXF drawings, by ezdxf (extra `cad`): lines, arcs, circles, polylines, ellipses, splines of model space.

| entity | becomes |
|---|---|
| LINE, ARC, CIRCLE | lines and arcs, exactly, in whatever plane |
| LWPOLYLINE, POLYLINE | lines, and of bulges arcs, exactly; of a smoothed one what the smoothing made of it |
| ELLIPSE | a spline through points, within the option `deviation`; an arc where its axes are alike |
| SPLINE | the same, in parts where it has corners; lines where its degree is 1 |

Texts, dimensions, points, hatches and the like (`ANNOTATIONS`) are skipped with a warning, or with the option `strict`
refused. Everything else is a fault, told by its handle, layer and kind: leave its layer out, or change the drawing.
Entities whose ends are within `tolerance` become one contour, turned round where they have to be. What lies between the
ends is closed by leading the next one from where the path stands. Widths and thicknesses are ignored. Coordinates stay
the drawing's: the option `origin` makes the program's work frame, in which its plane lies anywhere.

ezdxf keeps no places: on which line of the file an entity or a variable of the header stands is found beside it.
"""

import re
from collections import Counter, defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np

from kinematics.foundation.errors import Fault, FileError, MotionError, NotInstalled
from kinematics.foundation.names import count_noun, nearest
from kinematics.foundation.options import option
from kinematics.foundation.units import describe_value
from planner.program.model import Line, Program
from planner.program.modifiers import choose_join
from planner.program.validation import check_positive
from planner.sources.contours import Cutting, chain_strokes, make_segments
from planner.sources.dxf_shapes import StrokeMaker
from planner.sources.positions import read_frame
from planner.sources.source import Faults, Imported, read_all_bytes
from planner.sources.stroke import Chain


def find_line(path: Path, code: int, value: str) -> int | None:
    """The first line whose value is this one, behind its group code; None where there is none, as in a binary file.

    A handle stands behind code 5, a variable's name behind 9.
    """
    lines = [line.strip() for line in read_all_bytes(path).decode("utf-8", "replace").splitlines()]
    for n in range(0, len(lines) - 1, 2):
        if lines[n] == str(code) and lines[n + 1].upper() == value.upper():
            return n + 2
    return None


METRES = {
    1: 0.0254, 2: 0.3048, 3: 1609.344, 4: 1e-3, 5: 1e-2, 6: 1.0, 7: 1e3, 8: 25.4e-9, 9: 25.4e-6, 10: 0.9144,
    13: 1e-6, 14: 0.1, 15: 10.0, 16: 100.0,
}  # fmt: skip
"""m of the units that $INSUNITS can name."""
LAST_CODE = 24
HANDLE_CODE, VARIABLE_CODE = 5, 9
"""Group codes."""
ANNOTATIONS = frozenset(
    {
        "TEXT", "MTEXT", "RTEXT", "ATTDEF", "ATTRIB", "DIMENSION", "ARC_DIMENSION", "LARGE_RADIAL_DIMENSION", "LEADER",
        "MULTILEADER", "MLEADER", "TOLERANCE", "POINT", "HATCH", "IMAGE", "WIPEOUT", "VIEWPORT", "ACAD_TABLE",
    }
)  # fmt: skip
"""Kinds of entities that explain a drawing, and move nothing."""
MAX_HANDLES = 1000
"""Entities of a kind and layer that are named one by one."""


@dataclass(frozen=True, slots=True)
class DxfDrawing:
    """Its entities, in their order; m of its unit; and what its user has to know."""

    entities: list[Any]
    metres: float
    warnings: list[str]


def read_drawing(path: Path, options: "Dxf") -> DxfDrawing:
    """Raises FileError for what is no DXF file, is broken or has no unit; NotInstalled where ezdxf is not there."""
    try:
        from ezdxf.filemanagement import readfile
    except ImportError:
        raise NotInstalled("a DXF file", "ezdxf", "cad") from None
    raw = read_all_bytes(path)
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
        more = "" if told.endswith("is not a DXF file.") else "; the rest was not checked"
        message = f"not a readable DXF file: {describe_value(told)}{more}"
        raise FileError(str(path), [Fault("", message, line if more else 1)]) from None
    warnings = [
        f"not read: {count_noun(count, 'entity')} of layout {describe_value(name)}"
        for name, count in papers.items()
        if count
    ]
    metres = _read_unit(path, document.units if b"$INSUNITS" in raw else 0, options.length, warnings)
    taken = _select_entities(path, entities, layers, options, warnings)
    return DxfDrawing(taken, metres, warnings)


def _read_unit(path: Path, code: int, length: str | None, warnings: list[str]) -> float:
    """ezdxf takes metres where a file says nothing: so whether it says something is asked of the file itself."""
    from kinematics.foundation.units import unit_value

    said = METRES.get(code)
    if length is None:
        if said is None:
            told = "states no unit ($INSUNITS)" if not code else f"states unit {code} ($INSUNITS), which is not known"
            line = find_line(path, VARIABLE_CODE, "$INSUNITS") or 1
            told = f'the drawing {told}; give the option length, e.g. "mm"'
            raise FileError(str(path), [Fault("$INSUNITS", told, line)])
        return said
    given = unit_value(length, "m")
    if said is not None and said != given:
        warnings.append(f"the drawing states units of {said * 1e3:g} mm; {length} was taken, as the option says")
    return given


def _select_entities(
    path: Path, entities: list[Any], layers: dict[str, Any], options: "Dxf", warnings: list[str]
) -> list[Any]:
    """Those of the layers that count: named ones, or all but skipped and hidden ones."""
    named, skipped = options.layer_names, options.skipped_layers
    known = layers.keys() | {layer_of(entity).lower() for entity in entities}
    for name in [*named, *skipped]:
        if name not in known:
            offered = ", ".join(describe_value(layer) for layer in sorted(known)[:20])
            raise FileError(str(path), [Fault("", f'no layer "{name}"{nearest(name, known)}; its layers: {offered}')])
    hidden = {name for name, layer in layers.items() if layer.is_off() or layer.is_frozen()} - set(named)
    left, taken = Counter[str](), []
    for entity in entities:
        layer = layer_of(entity).lower()
        if (named and layer not in named) or layer in skipped:
            left[f"on layer {describe_value(layer_of(entity))}, as the options say"] += 1
        elif layer in hidden:
            left[f"on layer {describe_value(layer_of(entity))}, which is off or frozen"] += 1
        elif entity.dxf.hasattr("invisible") and entity.dxf.invisible:
            left["marked invisible"] += 1
        else:
            taken.append(entity)
    warnings += [f"skipped {count_noun(count, 'entity')} {why}" for why, count in left.items()]
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
        more = f" and {len(handles) - MAX_HANDLES} more" if len(handles) > MAX_HANDLES else ""
        remedy = "explode it" if kind in ("INSERT", "DIMENSION", "MLINE", "POLYLINE") else "take it out"
        faults.add(
            f"{kind} is not supported: {remedy}, or skip its layer; handle{'s' * (len(handles) > 1)} "
            f"{', '.join(handles[:MAX_HANDLES])}{more}",
            find_line(path, HANDLE_CODE, handles[0]),
            f"layer {describe_value(layer)}",
        )


@dataclass(frozen=True, slots=True)
class Dxf:
    """DXF drawings: lines, arcs, circles, polylines, ellipses, splines. Texts and the like are skipped."""

    suffixes: ClassVar[tuple[str, ...]] = (".dxf",)
    length: str | None = option(None, 'unit of the drawing, as "mm". Default: as the drawing states')
    layers: str | None = option(None, 'only these layers, as "CUT, MARK". Default: all that are on and not frozen')
    skip: str | None = option(None, 'layers to leave out, as "NOTES, 0"')
    tolerance: float = option(1e-5, "ends this close are joined. Default 0.01 mm", "m")
    deviation: float = option(1e-6, "largest deviation from ellipses and splines. Default 0.001 mm", "m")
    order: Literal["nearest", "file"] = option(
        "nearest",
        "order of contours: nearest shortens the moves between them, file keeps the drawing's. Default nearest",
    )
    join: Literal["through", "stop"] = option(
        "through", "joins inside contours: through passes smooth joins, stop rests. Default through"
    )
    blend: float | None = option(None, 'round joins within this tolerance instead, as "0.05 mm"', "m")
    fit: float | None = option(None, 'fit smooth curves within this tolerance instead, as "0.02 mm"', "m")
    speed: float | None = option(None, "limit of the tool speed along contours. Default: none", "m/s")
    rapid: float | None = option(None, "limit of the tool speed between contours. Default: none", "m/s")
    retract: float | None = option(
        None, "height of moves between contours above the drawing's plane. Default: in the plane", "m"
    )
    approach: float = option(
        0.0, "height above a contour's start from which the tool descends at speed. Default 0", "m"
    )
    lead_in: float | None = option(None, "length of a tangential lead-in to closed contours. Default: none", "m")
    lead: Literal["line", "arc"] = option("line", "shape of the lead-in: straight, or a quarter circle. Default line")
    side: Literal["outside", "inside"] = option("outside", "side of a quarter-circle lead-in. Default outside")
    origin: str | None = option(
        None, 'position of the drawing\'s zero from home, as "0 mm, 0 mm, 25 mm" or with three angles. Default: at home'
    )

    strict: bool = option(False, "refuse texts, dimensions, points and hatches instead of skipping them with a warning")

    def __post_init__(self) -> None:
        units = dict.fromkeys(("blend", "fit", "lead_in", "tolerance", "deviation"), "m") | {
            "speed": "m/s",
            "rapid": "m/s",
        }
        for name, unit in units.items():
            check_positive("dxf", name, getattr(self, name), unit)
        if not (np.isfinite(self.approach) and self.approach >= 0 and np.isfinite(self.retract or 0)):
            raise MotionError("dxf: retract and approach must be finite, and approach not negative")
        if self.approach and self.retract is None:
            raise MotionError("dxf: approach needs retract, the height that it starts from")

    @property
    def layer_names(self) -> list[str]:
        return _names(self.layers)

    @property
    def skipped_layers(self) -> list[str]:
        return _names(self.skip)

    def read(self, path: Path) -> Imported:
        """The program of a DXF file. Raises FileError with its faults; MotionError where ezdxf is not installed."""
        faults = Faults(str(path))
        found = read_drawing(path, self)
        shapes = StrokeMaker(found.metres, self.deviation)
        others = [entity for entity in found.entities if not shapes.knows(entity)]
        ignored = frozenset[str]() if self.strict else ANNOTATIONS
        refuse_unknown(path, [one for one in others if one.dxftype() not in ignored], faults)
        parts: list[Chain] = []
        for entity in found.entities:
            if shapes.knows(entity):
                try:
                    parts += shapes.strokes(entity)
                except Exception as wrong:  # ours, or what ezdxf comes upon in an entity that it has read
                    handle = str(entity.dxf.handle)
                    fault = str(wrong) if isinstance(wrong, MotionError) else f"broken: {wrong}"
                    faults.add(fault, find_line(path, HANDLE_CODE, handle), f"{entity.dxftype()} {handle}")
        kept, short = _drop_short_lines(parts, self.tolerance)
        if not faults and not kept:
            faults.add("nothing to run: no lines or curves longer than the tolerance on these layers")
        faults.refuse()
        chains, forks = chain_strokes(kept, self.tolerance)
        closed = [bool(np.linalg.norm(chain[0].start - chain[-1].end) <= self.tolerance) for chain in chains]
        work = None if self.origin is None else read_frame(self.origin)
        start = np.zeros(3) if work is None else work.inv().translation
        segments = make_segments(chains, closed, self._read_cutting(), np.asarray(start))
        program = Program(segments, "home", name=path.stem, work=work)
        kinds = Counter(one.dxftype() for one in others)
        drawn = Counter(entity.dxftype() for entity in found.entities) - kinds
        told = [*found.warnings, *_describe_skipped(kinds), *self._warnings(shapes, short, forks, len(chains))]
        return Imported(program, dict(sorted(drawn.items())), tuple(told))

    def _read_cutting(self) -> Cutting:
        join = choose_join(self.join, self.blend, self.fit)
        return Cutting(
            join, self.rapid, self.speed, self.retract, self.approach, self.lead_in, self.lead, self.side,
            self.order == "nearest",
        )  # fmt: skip

    def _warnings(self, shapes: StrokeMaker, short: int, forks: int, contours: int) -> list[str]:
        told = []
        if shapes.worst:
            told.append(f"ellipses and splines are curves through points, off by {shapes.worst * 1e6:.3g} um at most")
        if shapes.nothing:
            told.append(f"skipped {count_noun(shapes.nothing, 'shape')} without length (lines, arcs, polyline sides)")
        if short:
            told.append(f"skipped {count_noun(short, 'entity')} shorter than the tolerance")
        if shapes.flattened:
            told.append(
                f"{count_noun(shapes.flattened, 'entity')} with a width or a thickness: the path is the centre line"
            )
        if forks:
            forked = f"{count_noun(forks, 'point')} with more than two ends"
            told.append(f"{forked}: contours continue there in the straightest direction")
        if contours > 1 and self.retract is None:
            told.append(f"{contours} contours, and no retract: moves between them lie in the drawing's plane")
        return told


def _describe_skipped(kinds: Counter[str]) -> list[str]:
    listed = ", ".join(f"{kind} ({count}×)" for kind, count in sorted(kinds.items()))
    return [f"skipped {listed}: nothing to trace; strict refuses them"] if listed else []


def _names(text: str | None) -> list[str]:
    return [name.strip().lower() for name in (text or "").split(",") if name.strip()]


def _drop_short_lines(parts: list[Chain], tolerance: float) -> tuple[list[Chain], int]:
    """Without lines that are all within the tolerance, which their own two ends would close; and how many they are."""
    kept = [
        chain
        for chain in parts
        if len(chain) > 1
        or not isinstance(chain[0].segment, Line)
        or np.linalg.norm(chain[0].end - chain[0].start) > tolerance
    ]
    return kept, len(parts) - len(kept)
