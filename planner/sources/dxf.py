"""DXF drawings, by ezdxf (extra `cad`): lines, arcs, circles, polylines, ellipses, splines and
blocks of model space.

| entity | becomes |
|---|---|
| LINE, ARC, CIRCLE | lines and arcs, exactly, in any plane |
| LWPOLYLINE, POLYLINE | lines, and arcs where a side has a bulge, exactly; a smoothed one as the smoothing made it |
| ELLIPSE | a spline through points, within the option `deviation`; an arc where its axes are equal |
| SPLINE | a spline through points as well, in parts where it has corners or gaps; lines where its degree is 1 |
| INSERT | the entities of its block: moved, turned, scaled, mirrored, nested, in arrays |

Texts, dimensions, points, hatches and the like (`ANNOTATIONS`) are skipped with a warning, or
refused with the option `strict`. Everything else is a fault, named by its handle, layer and kind:
leave its layer out, or change the drawing. Entities whose ends are within `tolerance` become one
contour and are reversed where necessary. A gap at a join is closed: the next entity starts where
the path is. Widths and thicknesses are ignored. Coordinates remain those of the drawing. The option
`origin` makes the program's work frame, so that the drawing's plane may lie anywhere.

ezdxf does not keep line numbers. The line of an entity or of a header variable is searched in the
file.
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
from planner.sources.dxf_blocks import PlacedEntity, expand_blocks
from planner.sources.dxf_shapes import StrokeMaker
from planner.sources.positions import read_frame
from planner.sources.source import Faults, Imported, read_all_bytes
from planner.sources.stroke import Chain


def find_line(path: Path, code: int, value: str, section: str = "") -> int | None:
    """Return the first line with this group code and value, None if no line has them, as in a
    binary file.

    section: name of a section, to search only from its beginning on. The code of a handle is 5,
    that of a variable's name 9, that of an entity's kind 0.
    """
    lines = [line.strip() for line in read_all_bytes(path).decode("utf-8", "replace").splitlines()]
    begun = not section
    for n in range(0, len(lines) - 1, 2):
        begun = begun or (lines[n] == str(NAME_CODE) and lines[n + 1] == section)
        if begun and lines[n] == str(code) and lines[n + 1].upper() == value.upper():
            return n + 2
    return None


METRES = {
    1: 0.0254, 2: 0.3048, 3: 1609.344, 4: 1e-3, 5: 1e-2, 6: 1.0, 7: 1e3, 8: 25.4e-9, 9: 25.4e-6, 10: 0.9144,
    13: 1e-6, 14: 0.1, 15: 10.0, 16: 100.0,
}  # fmt: skip
"""Size (m) of the units that $INSUNITS can name."""
KIND_CODE, NAME_CODE, HANDLE_CODE, VARIABLE_CODE = 0, 2, 5, 9
"""Group codes."""
ANNOTATIONS = frozenset(
    {
        "TEXT", "MTEXT", "RTEXT", "ATTDEF", "ATTRIB", "DIMENSION", "ARC_DIMENSION", "LARGE_RADIAL_DIMENSION", "LEADER",
        "MULTILEADER", "MLEADER", "TOLERANCE", "POINT", "HATCH", "IMAGE", "WIPEOUT", "VIEWPORT", "ACAD_TABLE",
    }
)  # fmt: skip
"""Kinds of entities that explain a drawing and move nothing."""
MAX_HANDLES = 1000
"""Largest number of entities of a kind and layer that are named one by one."""


@dataclass(frozen=True, slots=True)
class DxfDrawing:
    """Entities of a drawing, with those of blocks, in their order; size of its unit, m; and
    warnings.
    """

    entities: list[PlacedEntity]
    metres: float
    warnings: list[str]


def read_drawing(path: Path, options: "Dxf") -> DxfDrawing:
    """Read the entities of model space that the options select.

    Raises FileError for a file that is not DXF, is broken or has no unit; NotInstalled where ezdxf
    is missing.
    """
    try:
        from ezdxf.filemanagement import readfile
    except ImportError:
        raise NotInstalled("a DXF file", "ezdxf", "cad") from None
    raw = read_all_bytes(path)
    try:
        document = readfile(path)
        entities = expand_blocks(document.modelspace())
        layers = {layer.dxf.name.lower(): layer for layer in document.layers}
        papers = Counter(
            {
                name: len(document.layout(name))
                for name in document.layout_names()
                if name.lower() != "model"
            }
        )
    except MotionError as error:
        raise FileError(str(path), [Fault("", str(error))]) from None
    except Exception as error:  # any error of the parser
        raise FileError(str(path), [_describe_parser_error(path, raw, error)]) from None
    warnings = [
        f"not read: {count_noun(count, 'entity')} of layout {describe_value(name)}"
        for name, count in papers.items()
        if count
    ]
    metres = _read_unit(
        path, document.units if b"$INSUNITS" in raw else 0, options.length, warnings
    )
    selected = _select_entities(path, entities, layers, options, warnings)
    return DxfDrawing(selected, metres, warnings)


def _describe_parser_error(path: Path, raw: bytes, error: Exception) -> Fault:
    """Make a fault of an error of ezdxf, at the line that it names, else at the end of the file."""
    message = str(error).removeprefix(f"{type(error).__name__}: ")
    message = message.replace(str(path), "it").replace("File 'it'", "it")
    if message.endswith("is not a DXF file."):
        return Fault("", f"not a readable DXF file: {describe_value(message)}", 1)
    line = max(1, raw.count(b"\n"))
    if named := re.search(r"near line: (\d+)", message):
        line = int(named[1])
    elif named := re.search(r"\(#([0-9A-Fa-f]+)\)", message):
        line = find_line(path, HANDLE_CODE, named[1]) or line
    elif named := re.search(r"for entity (\w+)$", message):
        # such a kind does not belong among entities, but may stand in an earlier section as well
        line = find_line(path, KIND_CODE, named[1], "ENTITIES") or line
        message = f"{named[1]} is no entity of a drawing"
    return Fault(
        "", f"not a readable DXF file: {describe_value(message)}; the rest was not checked", line
    )


def _read_unit(path: Path, code: int, length: str | None, warnings: list[str]) -> float:
    """Return the size of the drawing's unit, m.

    code: the file's $INSUNITS, 0 where it has none; for such a file ezdxf would return metres.
    """
    from kinematics.foundation.units import unit_value

    stated = METRES.get(code)
    if length is None:
        if stated is None:
            reason = (
                "states no unit ($INSUNITS)"
                if not code
                else f"states unit {code} ($INSUNITS), which is not known"
            )
            line = find_line(path, VARIABLE_CODE, "$INSUNITS") or 1
            message = f'the drawing {reason}; give the option length, e.g. "mm"'
            raise FileError(str(path), [Fault("$INSUNITS", message, line)])
        return stated
    given = unit_value(length, "m")
    if stated is not None and stated != given:
        warnings.append(
            f"the drawing states units of {stated * 1e3:g} mm; {length} was taken, as the option says"
        )
    return given


def _select_entities(
    path: Path,
    entities: list[PlacedEntity],
    layers: dict[str, Any],
    options: "Dxf",
    warnings: list[str],
) -> list[PlacedEntity]:
    """Select the entities of the named layers, or all but those of skipped and hidden layers.

    Skipping or freezing the layer of an INSERT leaves all of its contents out.
    """
    named, skipped = options.layer_names, options.skipped_layers
    known = layers.keys() | {name.lower() for one in entities for name in (one.layer, *one.parents)}
    for name in [*named, *skipped]:
        if name not in known:
            offered = ", ".join(describe_value(layer) for layer in sorted(known)[:20])
            raise FileError(
                str(path),
                [Fault("", f'no layer "{name}"{nearest(name, known)}; its layers: {offered}')],
            )
    off = {name for name, layer in layers.items() if layer.is_off()} - set(named)
    frozen = {name for name, layer in layers.items() if layer.is_frozen()} - set(named)
    left_out, selected = Counter[str](), []
    for one in entities:
        layer = one.layer.lower()
        chain = (one.layer, *one.parents)
        if named and layer not in named:
            left_out[f"on layer {describe_value(one.layer)}, as the options say"] += 1
        elif skip := next((name for name in chain if name.lower() in skipped), None):
            left_out[f"on layer {describe_value(skip)}, as the options say"] += 1
        elif layer in off or layer in frozen:
            left_out[f"on layer {describe_value(one.layer)}, which is off or frozen"] += 1
        elif hidden := next((name for name in one.parents if name.lower() in frozen), None):
            left_out[f"of blocks on layer {describe_value(hidden)}, which is frozen"] += 1
        elif not one.visible:
            left_out["marked invisible"] += 1
        else:
            selected.append(one)
    warnings += [f"skipped {count_noun(count, 'entity')} {why}" for why, count in left_out.items()]
    return selected


def refuse_unknown(path: Path, entities: list[PlacedEntity], faults: Faults) -> None:
    """Add a fault for each kind and layer of unsupported entities: the line of the first, the
    handles of all.
    """
    groups: dict[tuple[str, str, str], list[str]] = defaultdict(list)
    for one in entities:
        groups[one.entity.dxftype(), one.layer, one.fault].append(str(one.entity.dxf.handle))
    for (kind, layer, fault), copies in groups.items():
        handles = list(
            dict.fromkeys(copies)
        )  # an entity of a block once, however many copies there are
        more = f" and {len(handles) - MAX_HANDLES} more" if len(handles) > MAX_HANDLES else ""
        remedy = "explode it" if kind in ("DIMENSION", "MLINE", "POLYLINE") else "take it out"
        reason = fault or f"{kind} is not supported: {remedy}, or skip its layer"
        faults.add(
            f"{reason}; handle{'s' * (len(handles) > 1)} {', '.join(handles[:MAX_HANDLES])}{more}",
            find_line(path, HANDLE_CODE, handles[0]),
            f"layer {describe_value(layer)}",
        )


@dataclass(frozen=True, slots=True)
class Dxf:
    """DXF drawings: lines, arcs, circles, polylines, ellipses, splines, blocks. Texts and the like are
    skipped.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".dxf",)
    length: str | None = option(
        None, 'unit of the drawing, as "mm". Default: as the drawing states'
    )
    layers: str | None = option(
        None, 'only these layers, as "CUT, MARK". Default: all that are on and not frozen'
    )
    skip: str | None = option(None, 'layers to leave out, as "NOTES, 0"')
    tolerance: float = option(
        1e-5, "ends this close are joined. Default 0.01 mm", "m", like="0.01 mm"
    )
    deviation: float = option(
        1e-6, "largest deviation from ellipses and splines. Default 0.001 mm", "m", like="0.001 mm"
    )
    order: Literal["nearest", "file"] = option(
        "nearest",
        "order of contours: nearest shortens the moves between them, file keeps the drawing's. Default nearest",
    )
    join: Literal["through", "stop"] = option(
        "through", "joins inside contours: through passes smooth joins, stop rests. Default through"
    )
    blend: float | None = option(
        None, 'round joins within this tolerance instead, as "0.05 mm"', "m", like="0.05 mm"
    )
    fit: float | None = option(
        None, 'fit smooth curves within this tolerance instead, as "0.02 mm"', "m", like="0.02 mm"
    )
    speed: float | None = option(
        None, "limit of the tool speed along contours. Default: none", "m/s"
    )
    rapid: float | None = option(
        None, "limit of the tool speed between contours. Default: none", "m/s"
    )
    retract: float | None = option(
        None,
        "height of moves between contours above the drawing's plane. Default: in the plane",
        "m",
    )
    approach: float = option(
        0.0, "height above a contour's start from which the tool descends at speed. Default 0", "m"
    )
    lead_in: float | None = option(
        None, "length of a tangential lead-in to closed contours. Default: none", "m"
    )
    lead: Literal["line", "arc"] = option(
        "line", "shape of the lead-in: straight, or a quarter circle. Default line"
    )
    side: Literal["outside", "inside"] = option(
        "outside", "side of a quarter-circle lead-in. Default outside"
    )
    origin: str | None = option(
        None,
        'position of the drawing\'s zero from home, as "0 mm, 0 mm, 25 mm" or with three angles. Default: at home',
    )

    strict: bool = option(
        False,
        "refuse texts, dimensions, points and hatches instead of skipping them with a warning",
    )

    def __post_init__(self) -> None:
        units = dict.fromkeys(("blend", "fit", "lead_in", "tolerance", "deviation"), "m") | {
            "speed": "m/s",
            "rapid": "m/s",
        }
        for name, unit in units.items():
            check_positive("dxf", name, getattr(self, name), unit)
        if not (
            np.isfinite(self.approach) and self.approach >= 0 and np.isfinite(self.retract or 0)
        ):
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
        """Return the program of a DXF file.

        Raises FileError with its faults; MotionError where ezdxf is missing.
        """
        faults = Faults(str(path))
        drawing = read_drawing(path, self)
        shapes = StrokeMaker(drawing.metres, self.deviation)
        traced = [one for one in drawing.entities if shapes.knows(one.entity)]
        others = [one for one in drawing.entities if not shapes.knows(one.entity)]
        ignored = frozenset[str]() if self.strict else ANNOTATIONS
        refuse_unknown(path, [one for one in others if one.entity.dxftype() not in ignored], faults)
        parts: list[Chain] = []
        for one in traced:
            entity = one.entity
            try:
                parts += shapes.strokes(entity, one.placement)
            except Exception as error:  # ours, or an error of ezdxf in an entity that it has read
                handle = str(entity.dxf.handle)
                fault = str(error) if isinstance(error, MotionError) else f"broken: {error}"
                faults.add(
                    fault, find_line(path, HANDLE_CODE, handle), f"{entity.dxftype()} {handle}"
                )
        lines, short = _drop_short_lines(parts, self.tolerance)
        if not faults and not lines:
            faults.add(
                "nothing to run: no lines or curves longer than the tolerance on these layers"
            )
        faults.refuse()
        chains, forks = chain_strokes(lines, self.tolerance)
        closed = [
            bool(np.linalg.norm(chain[0].start - chain[-1].end) <= self.tolerance)
            for chain in chains
        ]
        work = None if self.origin is None else read_frame(self.origin)
        start = np.zeros(3) if work is None else work.inv().translation
        segments = make_segments(chains, closed, self._read_cutting(), np.asarray(start))
        program = Program(segments, "home", name=path.stem, work=work)
        skipped = Counter(one.entity.dxftype() for one in others)
        drawn = Counter(one.entity.dxftype() for one in traced)
        warnings = [*drawing.warnings, *_describe_skipped(skipped)]
        warnings += self._warnings(shapes, short, forks, len(chains))
        return Imported(program, dict(sorted(drawn.items())), tuple(warnings))

    def _read_cutting(self) -> Cutting:
        join = choose_join(self.join, self.blend, self.fit)
        return Cutting(
            join, self.rapid, self.speed, self.retract, self.approach, self.lead_in, self.lead, self.side,
            self.order == "nearest",
        )  # fmt: skip

    def _warnings(self, shapes: StrokeMaker, short: int, forks: int, contours: int) -> list[str]:
        lines = []
        if shapes.worst:
            lines.append(
                f"ellipses and splines are curves through points, off by {shapes.worst * 1e6:.3g} um at most"
            )
        if shapes.nothing:
            lines.append(
                f"skipped {count_noun(shapes.nothing, 'shape')} without length (lines, arcs, polyline sides)"
            )
        if short:
            lines.append(f"skipped {count_noun(short, 'entity')} shorter than the tolerance")
        if shapes.flattened:
            lines.append(
                f"{count_noun(shapes.flattened, 'entity')} with a width or a thickness: the path is the centre line"
            )
        if forks:
            forked = f"{count_noun(forks, 'point')} with more than two ends"
            lines.append(f"{forked}: contours continue there in the straightest direction")
        if contours > 1 and self.retract is None:
            lines.append(
                f"{contours} contours, and no retract: moves between them lie in the drawing's plane"
            )
        return lines


def _describe_skipped(kinds: Counter[str]) -> list[str]:
    listed = ", ".join(f"{kind} ({count}×)" for kind, count in sorted(kinds.items()))
    return [f"skipped {listed}: nothing to trace; strict refuses them"] if listed else []


def _names(text: str | None) -> list[str]:
    return [name.strip().lower() for name in (text or "").split(",") if name.strip()]


def _drop_short_lines(parts: list[Chain], tolerance: float) -> tuple[list[Chain], int]:
    """Drop lines that are shorter than the tolerance: their own two ends would be joined.

    Return the rest, and how many were dropped.
    """
    kept = [
        chain
        for chain in parts
        if len(chain) > 1
        or not isinstance(chain[0].segment, Line)
        or np.linalg.norm(chain[0].end - chain[0].start) > tolerance
    ]
    return kept, len(parts) - len(kept)
