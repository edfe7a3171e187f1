"""The command `view`: a page in a file, one that is served, and still images, of the plan that is
in a directory.
"""

import json
import os
import signal
import socket
import struct
import subprocess
import sys
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest

from benchmarks.animation.animate import document
from pulsepath.page_server import answer_page, serve_pages


def test_the_page_is_that_of_the_plan(call, plan, job, tmp_path):
    file = tmp_path / "way.html"
    done = call("view", plan, "--html", file, "--frames", 5, "--json")
    assert done.exit_code == 0
    told = json.loads(done.stdout)
    assert told == {
        "program": "bare-circle",
        "machine": "hexapod",
        "html": str(file),
        "frames": 5,
        "bytes": file.stat().st_size,
        "verified": True,
        "doubts": [],
    }
    # what the directory holds is the motion that was planned: the legends agree, frame by frame
    page, same = file.read_text(encoding="utf-8"), document(job.plan, 5)
    assert legend(page) == legend(same)


def legend(page):
    return json.loads(page.split('id="frames">')[1].split("</script>")[0])


def test_a_file_is_replaced_only_by_force(call, plan, tmp_path):
    file = tmp_path / "way.html"
    file.write_text("mine")
    done = call("view", plan, "--html", file, "--frames", 2)
    assert done.exit_code == 2
    assert "give --force to replace it" in done.stderr
    assert file.read_text() == "mine"
    assert call("view", plan, "--html", file, "--frames", 2, "--force").exit_code == 0
    assert file.read_text(encoding="utf-8").startswith("<!doctype html>")


def test_stills_at_an_instant(call, plan, tmp_path):
    file = tmp_path / "views.svg"
    done = call("view", plan, "--stills", file, "--at", "300 ms")
    assert done.exit_code == 0
    assert done.stdout == f"{file}\n"
    assert "0.300 s" in file.read_text(encoding="utf-8")


def test_bad_calls(call, plan, tmp_path):
    for arguments, told in [
        (["--html", tmp_path / "a.html", "--at", "1 s"], "--at needs --stills"),
        (["--stills", tmp_path / "a.gif"], "still images are one of .png, .svg, .pdf"),
        (["--stills", tmp_path / "a.pdf", "--at", "9 s"], "is not within the motion"),
        (["--stills", tmp_path / "a.pdf", "--at", "9 mm"], "mm"),
        (["--html", tmp_path / "a.html", "--frames", "1"], "x>=2"),
        (["--html", tmp_path / "a.html", "--frames", "100000"], "from 2 to"),
        (["--html", tmp_path / "a.html", "--magnify", "0"], "x>0"),
    ]:
        done = call("view", plan, *arguments)
        assert done.exit_code == 2, arguments
        assert told in done.stderr
        if "--stills" in arguments:  # refused before the motion is proved again
            assert "certifying" not in done.stderr
        assert not list(tmp_path.glob("a.*"))


def test_where_there_is_no_plan_it_says_what_track_says(call, tmp_path):
    viewed, tracked = call("view", tmp_path), call("track", tmp_path, "--law", "3")
    assert viewed.exit_code == tracked.exit_code == 2
    assert viewed.stderr == tracked.stderr
    assert "holds no plan" in viewed.stderr


@pytest.mark.parametrize(
    ("order", "words"), [(4, "order 4 is not known"), (None, "states no order")]
)
def test_a_plan_without_the_order_of_its_limits_is_refused(call, plan, order, words):
    record = json.loads((plan / "plan.json").read_text(encoding="utf-8"))
    record["request"]["order"] = order
    (plan / "plan.json").write_text(json.dumps(record), encoding="utf-8")
    done = call("view", plan, "--no-browser")
    assert done.exit_code == 2
    assert words in done.stderr


@pytest.fixture
def viewing(plan):
    """The address of a page that is served, and the process."""
    command = [
        sys.executable,
        "-m",
        "pulsepath",
        "view",
        str(plan),
        "--no-browser",
        "--frames",
        "2",
        "--json",
    ]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        lines = []
        for line in process.stdout:
            lines.append(line)
            if line == "}\n":
                break
        yield json.loads("".join(lines))["address"], process
        process.kill()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no SIGINT to one process")
def test_it_is_served_on_loopback_alone_until_ctrl_c(viewing):
    address, process = viewing
    port = int(address.rstrip("/").rsplit(":", 1)[1])
    assert address == f"http://127.0.0.1:{port}/"
    with urlopen(address, timeout=10) as answer:
        assert answer.headers["Content-Type"] == "text/html; charset=utf-8"
        assert "bare-circle on hexapod" in answer.read().decode()
    for path, host, code in [("other", None, 404), ("", "elsewhere.example", 403)]:
        request = Request(address + path, headers={"Host": host} if host else {})
        with pytest.raises(HTTPError) as refused:
            urlopen(request, timeout=10)
        assert refused.value.code == code
        refused.value.close()
    if (
        sys.platform == "linux"
    ):  # where all of 127/8 is this computer: what listens on every address would answer
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.2", port), timeout=10)
    os.kill(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=20)
    assert process.returncode == 0
    assert said.endswith("stopped\n")


def test_a_port_that_is_taken_is_told(call, plan):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = call("view", plan, "--frames", 2, "--no-browser", "--port", port)
    assert done.exit_code == 2
    assert f"127.0.0.1 port {port}" in done.stderr
    assert "another --port" in done.stderr


def test_a_browser_that_leaves_early_is_nobodys_fault(capsys):
    """It takes a little of a page that no buffer holds, and resets the connection."""
    with serve_pages(answer_page("x" * 20_000_000)) as address:
        port = int(address.rstrip("/").rsplit(":", 1)[1])
        with socket.socket() as visitor:
            visitor.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2000)
            visitor.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            visitor.connect(("127.0.0.1", port))
            visitor.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
            visitor.recv(100)
        with urlopen(address, timeout=10) as answer:  # the next one is served
            assert len(answer.read()) == 20_000_000
    assert capsys.readouterr().err == ""
