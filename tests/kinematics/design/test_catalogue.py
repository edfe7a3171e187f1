import pytest

from kinematics import FileError, load_actuators, load_joints

INCH = 0.0254


@pytest.fixture
def csv_file(tmp_path):
    def made(text):
        path = tmp_path / "parts.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return made


@pytest.fixture
def faults(csv_file):
    """Text -> every fault of the catalogue, as (line, column, message)."""

    def found(text, load=load_actuators):
        with pytest.raises(FileError) as caught:
            load(csv_file(text))
        return [(fault.line, fault.key, fault.message) for fault in caught.value.faults]

    return found


def test_bundled_actuators_are_table_3_1_in_si():
    parts = {part.name: part for part in load_actuators()}
    assert list(parts) == [
        "PI",
        "Ultra Motion",
        "Oriental",
        "HSI",
        "Intelidrives",
        "Linmot",
        "Iai",
        "Servoram",
    ]
    chosen = parts["HSI"]
    assert (chosen.stroke, chosen.force, chosen.precision, chosen.speed) == (
        0.0508,
        220,
        1.5e-6,
        0.076,
    )
    assert (chosen.mass, chosen.size, chosen.cost, chosen.type) == (
        0.241,
        (0.043, 0.043, 0.162),
        (120, 120),
        "stepper",
    )
    assert parts["Linmot"].mass == pytest.approx(1.2)  # 740 + 460 g, slider and stator
    assert parts["Intelidrives"].cost == (1700, 2000)
    assert parts["Intelidrives"].stroke is None


def test_bundled_joints():
    joint = load_joints()[0]
    assert joint.name == "Hephaist SRJ008C"
    assert (joint.force, joint.precision) == (540, 2.5e-6)
    assert joint.tilt == pytest.approx(0.7853981634)


def test_units_of_columns_and_of_cells(csv_file):
    head = "company,model,stroke_in,speed_in_s,force,mass_lb\n"
    text = head + 'A,7,2,3,10 lbf,1\nB,,"50.8 mm",76.2 mm/s,44.482216152605 N,-\n'
    first, second = load_actuators(csv_file(text))
    assert first.name == "A 7"
    assert first.stroke == second.stroke == 2 * INCH
    assert first.speed == pytest.approx(second.speed, rel=1e-15)
    assert first.force == pytest.approx(second.force, rel=1e-15)
    assert first.mass == 0.45359237
    assert second.mass is None


def test_comments_blank_lines_crlf_and_bom_keep_line_numbers(csv_file, faults):
    head = "\ufeff# source\r\n\r\ncompany,stroke_mm\r\n"
    assert load_actuators(csv_file(head + "A,5\r\n"))[0].line == 4
    assert faults(head + "A,5\r\n# so\r\nB,x\r\n")[0][0] == 6


@pytest.mark.parametrize(
    ("cell", "message"),
    [
        ("abc", '"abc": does not begin with a number'),
        ("nan", "not a finite number"),
        ("inf", "not a finite number"),
        ("-5", '"-5 mm" must be above 0 mm'),
        ("0", "must be above 0 mm"),
        ("5 N", "not convertible to mm"),
        ("5 lightyears", "unknown unit"),
        ("1e999", "too large"),
        ("5 mm; drop table", "is not a unit"),
    ],
)
def test_bad_cell_names_line_column_value_and_unit(faults, cell, message):
    ((line, column, text),) = faults(f"company,stroke_mm\nA,5\nB,{cell}\n")
    assert (line, column) == (3, "stroke_mm")
    assert message in text
    assert "mm" in text
    assert cell.split()[0].rstrip(";")[:3] in text


def test_every_fault_is_told_at_once(faults):
    found = faults("company,stroke_mm,force_N,cost_usd\nA,x,y,10\n,5,5,5\nC,5,5,2000-1700\nD,5\n")
    assert [(line, key) for line, key, _ in found] == [
        (2, "stroke_mm"), (2, "force_N"), (3, "company"), (4, "cost_usd"), (5, ""),
    ]  # fmt: skip
    assert "USD" in found[3][2]
    assert "2 cells for 4 columns" in found[4][2]


@pytest.mark.parametrize(
    ("header", "column", "message"),
    [
        ("company,strok_mm", "strok_mm", 'nearest is "stroke"'),
        ("company,stroke_N", "stroke_N", "no unit of a stroke"),
        ("company,stroke_mm,stroke_in", "stroke", "two columns"),
        ("stroke_mm,force_N", "company", "missing"),
        ("company,tilt_deg", "tilt_deg", "unknown column"),
    ],
)
def test_bad_header(faults, header, column, message):
    ((line, key, text),) = faults(f"{header}\n")
    assert (line, key) == (1, column)
    assert message in text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty"),
        ("company,stroke_mm\n", "no parts"),
        ("company,stroke\nA,5\n", "without a unit: name it in the column"),
        (b"company,stroke_mm\nA\xff,5\n", "not UTF-8"),
        ('company,stroke_mm\nA,"5\n', "not CSV"),
    ],
)
def test_unusable_files(faults, text, message):
    assert message in faults(text)[0][2]


def test_missing_file_is_a_motion_error(tmp_path):
    with pytest.raises(FileError, match="No such file"):
        load_joints(tmp_path / "none.csv")
