"""What each key of a program's file means, in the words of the file to start from (`planner.program_starter`)."""

from kinematics.commented import Key

HEAD = (
    Key("schema", "of this file"),
    Key("machine", "a bundled one by its name, or a file, from this one's folder; --machine says another"),
    Key("length", "unit of the plain numbers below"),
    Key("angle", "likewise; angles are θx, θy, θz about the moving axes in turn"),
    Key("frame", '"home": positions count from the home pose; "base": from the base frame', '"home"'),
    Key("start", "first pose, if not home: x, y, z, or these and three angles", "[0, 0, 0]"),
    Key("repeat", "how often the segments are run", "2"),
    Key("duration", "of the whole, as smoothly as it can; as fast as it can if not stated", '"60 s"'),
    Key("speed", "most of the tool, for segments that state none", '"100 mm/s"'),
    Key("acceleration", "likewise", '"1000 mm/s^2"'),
    Key("angular_speed", "likewise, of its turning", '"30 deg/s"'),
    Key(
        "tool",
        "what is moved, in the platform's frame",
        '{ to = ["0 mm", "0 mm", "10 mm"], rotate = ["0 deg", "0 deg", "0 deg"] }',
    ),
    Key(
        "work",
        "where positions count from, in the frame above",
        '{ to = ["0 mm", "0 mm", "0 mm"], rotate = ["0 deg", "0 deg", "0 deg"] }',
    ),
    Key("start_speed", "of the tool as it sets out; at rest if not stated", '"5 mm/s"'),
    Key("end_speed", "likewise as it arrives", '"5 mm/s"'),
)

_TURNED = "rotate: orientation at its end, kept if not stated"
SHAPES = {
    "line": Key(
        "line", f"straight; {_TURNED}", '{ to = ["10 mm", "0 mm", "25 mm"], rotate = ["0 deg", "0 deg", "3 deg"] }'
    ),
    "arc": Key(
        "arc",
        f"about a centre, right hand about the normal; rise: along the normal in all; {_TURNED}",
        '{ centre = ["0 mm", "0 mm", "25 mm"], normal = [0, 0, 1], angle = "360 deg", rise = "5 mm" }',
    ),
    "spline": Key(
        "spline",
        "smoothly through points; rotate: an orientation for each, kept if not stated",
        '{ through = [["10 mm", "5 mm", "25 mm"], ["0 mm", "10 mm", "25 mm"]] }',
    ),
    "curve": Key(
        "curve",
        "by equations, in the units above, from where the path stands; rx, ry, rz turn it; constants: numbers by name",
        '{ x = "r*cos(t)", y = "r*sin(t)", z = "25", from = 0, to = "2*pi", constants = { r = 10 } }',
    ),
    "turn": Key(
        "turn",
        "on the spot, to an orientation; or { about = [0, 0, 1], angle = 90 }",
        '{ to = ["5 deg", "0 deg", "0 deg"] }',
    ),
    "synchronised": Key(
        "synchronised",
        f"every axis straight to its place, all together: the tool's way is no line; {_TURNED}",
        '{ to = ["10 mm", "0 mm", "25 mm"], rotate = ["0 deg", "0 deg", "3 deg"] }',
    ),
    "dwell": Key("dwell", "a rest", '"0.2 s"'),
}
"""What a segment is: one of these."""

MODIFIERS = (
    Key("speed", "most of the tool along it", '"20 mm/s"'),
    Key("acceleration", "likewise", '"500 mm/s^2"'),
    Key("angular_speed", "likewise, of its turning", '"30 deg/s"'),
    Key("speed_constant", "exactly that speed, between ramps", "true", needs=("speed",)),
    Key(
        "join",
        'to the next segment: "stop" (if not stated), "through" (where it is smooth), or rounded within a tolerance; '
        'angle = "0.1 deg": of the turning too',
        '{ blend = "0.05 mm" }',
    ),
    Key("trigger", "an event; at: its share of the way, 1 (the end) if not stated", '{ name = "camera", at = 0.5 }'),
    Key(
        "free",
        'orientation that the planner may choose: "yaw", the turn about the tool\'s z; tilt: a lean of it as well',
        '{ yaw = true, tilt = "5 deg" }',
    ),
)
"""What a segment may say beside."""
