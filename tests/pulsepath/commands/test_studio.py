"""The command `studio`: the list of plans, two side by side, reports shown again, and planning when
a file is saved.
"""

import json
import os
import signal
import socket
import struct
import subprocess
import sys
import time
from html import unescape
from pathlib import Path
from queue import Queue
from re import findall, search
from shutil import copytree
from urllib.error import HTTPError
from urllib.parse import parse_qs, quote, urlsplit
from urllib.request import Request, urlopen

import pytest

from benchmarks.animation.animate import POLICY
from pulsepath.output.plan_list import PlanList
from pulsepath.output.studio import Replanner, Studio
from pulsepath.page_server import PAGE, REPORT_POLICY, serve_pages
from tests.browser import act_in, needs_browser, visit


@pytest.fixture
def two(directory, tmp_path):
    """A folder of two plans, the second a tenth longer, and much that is no plan."""
    folder = tmp_path / "plans"
    for name in ("first", "deep/er/second <b>"):
        copytree(directory, folder / name)
    record = json.loads((folder / "deep/er/second <b>/plan.json").read_text(encoding="utf-8"))
    record["duration_s"] *= 1.1
    (folder / "deep/er/second <b>/plan.json").write_text(json.dumps(record), encoding="utf-8")
    (folder / "damaged").mkdir()
    (folder / "damaged/plan.json").write_text("{", encoding="utf-8")
    (folder / "damaged/report.html").write_text("not to be seen", encoding="utf-8")
    (folder / "else").mkdir()
    (folder / "else/report.html").write_text("not to be seen", encoding="utf-8")
    return folder


def page_of(studio, *names):
    left, right = {"left": list(names[:1])}, {"right": list(names[1:])}
    found = (
        studio.answer("/compare", left | right)
        if names[1:]
        else studio.answer("/", {"show": list(names)})
    )
    kind, content = found
    assert kind.startswith("text/html")
    return content.decode()


def test_plans_are_found_and_nothing_else(two):
    assert [one.name for one in PlanList(two).find()] == ["deep/er/second <b>", "first"]
    assert [one.name for one in PlanList(two / "first").find()] == ["."]


def test_the_page_names_them_and_obeys_no_name(two):
    page = page_of(Studio(two))
    assert "second &lt;b&gt;" in page
    assert "<b>" not in page
    assert page.count('<a class="beside"') == 0
    assert "bare-circle on hexapod" in page


def test_two_are_held_against_each_other(two):
    page = page_of(Studio(two), "first", "deep/er/second <b>")
    assert page.count("<iframe") == 2
    row = page.split('<th scope="row">duration</th>')[1].split("</tr>")[0]
    assert "(+10 %)" in row
    assert page_of(Studio(two), "first").count("<iframe") == 1
    assert page_of(Studio(two), "none").count("<iframe") == 0


def test_a_comparison_has_an_address_and_each_frame_the_name_of_its_plan(two):
    page = page_of(Studio(two), "first")
    url = urlsplit(unescape(search(r'class="beside" href="([^"]*)"', page)[1]))
    assert url.path == "/compare"
    assert parse_qs(url.query) == {"left": ["first"], "right": ["deep/er/second <b>"]}
    page = (
        Studio(two).answer(url.path, parse_qs(url.query))[1].decode()
    )  # of another studio: nothing is remembered
    titles = findall(r'<iframe title="([^"]*)"', page)
    assert titles == ["first: report", "deep/er/second &lt;b&gt;: report"]
    headings = findall(r"<h2><span>([^<]*)</span>", page)
    assert headings == ["first", "deep/er/second &lt;b&gt;"]
    assert "Not here: gone." in page_of(Studio(two), "first", "gone")


def test_the_current_folder_is_named(two, monkeypatch):
    monkeypatch.chdir(two)
    page = page_of(Studio(Path()))
    assert search(r"<h1[^>]*>([^<]*)</h1>", page)[1] == "plans"
    monkeypatch.chdir(two / "first")
    page = page_of(Studio(Path()), ".")
    assert "<title>first – pulsepath studio</title>" in page
    assert '<iframe title="first: report"' in page


def find_row(page, label):
    """The cells of a row of differences."""
    row = page.split(f'<th scope="row">{label}</th>')[1].split("</tr>")[0]
    return findall(r"<td[^>]*>([^<]*)</td>", row)


def test_differences_tell_what_two_plans_were_made_of(two):
    """Shapers, what was lowered for them, order, objective, files and drive timing are rows of
    their own.
    """
    path = two / "deep/er/second <b>/plan.json"
    record = json.loads(path.read_text(encoding="utf-8"))
    leg = {"shapers": [{"kind": "zv", "frequency": 25.0, "damping": 0.05, "tolerance": 0.05}]}
    record["shaping"] = {
        "duration_before_s": 5.0,
        "cost": {
            "total_s": 0.02,
            "lowered": [{"limit": "jerk", "share": 0.9}, {"limit": "jerk", "share": 0.8}],
        },
        "axes": {"leg1": leg, "leg2": leg, "leg3": {"shapers": []}},
        "limits": {"jerk": {"worst_ratio": 1.0}},
    }
    record["order"] = 2
    record["request"]["duration_s"] = 20.0
    record["provenance"]["sha256"]["machine"] = "0123456789abcdef"
    for axis in record["pulses"]["axes"].values():
        axis["drive_needs_s"] = {
            "high": 1e-6,
            "low": 1e-6,
            "setup": 1e-6,
            "hold": 1e-6,
            "max_rate": None,
        }
        axis["lines_s"] = {"high": 2e-6, "low": 3e-6, "setup": 1.5e-6, "hold": 2e-6}
    path.write_text(json.dumps(record), encoding="utf-8")
    page = page_of(Studio(two), "first", "deep/er/second <b>")
    assert find_row(page, "input shapers") == [
        "none",
        "zv 25 Hz, damping 0.05 (leg1, leg2)",
        "differs",
    ]
    assert find_row(page, "limits lowered for them") == ["none", "jerk to 80.00 %", "differs"]
    assert find_row(page, "order") == ["3", "2", "differs"]
    assert find_row(page, "objective") == ["time", "a duration of 20 s", "differs"]
    assert find_row(page, "machine")[1:] == ["hexapod (file 01234567)", "differs"]
    assert find_row(page, "program")[2] == ""
    assert find_row(page, "cost of the shapers")[1] == "20 ms"
    assert find_row(page, "drive timing, least of kept / needed")[1] == "1.5 ×"
    assert find_row(page, "use of jerk, behind the shapers")[1] == "100 %"


@needs_browser
def test_on_a_phone_the_comparison_is_one_thing_at_a_time(two, tmp_path):
    """No page is wider than the window, and the tab in the address decides which report or the
    differences fill it.
    """
    script = """onload = async () => {
      const seen = [], ids = ["left", "right", "differences"], place = id => document.getElementById(id);
      for (const tab of ids) {
        location.hash = tab;
        await new Promise(done => setTimeout(done, 200));
        const shown = ids.filter(id => place(id).checkVisibility({ visibilityProperty: true }));
        const height = 100 * place(tab).getBoundingClientRect().height / innerHeight;
        seen.push([tab, shown, height, document.documentElement.scrollWidth - innerWidth]);
      }
      fetch("/said", { method: "POST", body: JSON.stringify(seen) });
    }"""
    page = tmp_path / "narrow.html"
    text = page_of(Studio(two), "first", "deep/er/second <b>").replace(
        "src=", "data-src="
    )  # reports are not looked at
    page.write_text(text, encoding="utf-8")
    seen, _ = act_in(tmp_path, page, script, "500,844")  # no window of Chromium is narrower
    for tab, shown, height, beyond in seen:
        assert shown == [tab]
        assert height > 75  # % of the window
        assert beyond <= 0


def test_a_report_is_given_and_no_other_file(two):
    studio = Studio(two)
    kind, content = studio.answer("/report", {"of": ["first"]})
    assert kind.startswith("text/html")
    assert content == (two / "first/report.html").read_bytes()
    for name in ("../plans/first", "/etc", "else", "damaged", "first/", ""):
        assert studio.answer("/report", {"of": [name]}) is None
    assert studio.answer("/first/plan.json", {}) is None
    assert studio.answer("/report", {}) is None


@pytest.mark.skipif(sys.platform == "win32", reason="links and pipes of POSIX")
@pytest.mark.parametrize("lead", ["link", "link to a link", "relative link", "pipe", "endless"])
@pytest.mark.parametrize("name", ["report.html", "plan.json"])
def test_no_file_outside_the_folder_is_given(two, tmp_path, lead, name):
    """Somebody else's folder may have links to any file that its reader can read, and files that
    never end.
    """
    place, secret = two / "first" / name, tmp_path / "secret"
    secret.write_bytes(place.read_bytes())
    place.unlink()
    if lead == "pipe":
        os.mkfifo(place)
    elif lead == "link to a link":
        (two / "first/between").symlink_to(secret)
        place.symlink_to("between")
    else:
        place.symlink_to(
            {"link": secret, "relative link": "../../secret", "endless": "/dev/zero"}[lead]
        )
    studio = Studio(two)
    assert studio.answer("/report", {"of": ["first"]}) is None
    assert studio.answer("/report", {"of": ["deep/er/second <b>"]}) is not None
    assert "second &lt;b&gt;" in page_of(studio)


@pytest.mark.skipif(sys.platform == "win32", reason="links of POSIX")
def test_a_link_inside_the_folder_is_followed_and_so_is_one_to_the_folder(two, tmp_path):
    (two / "first/report.html").rename(two / "kept.html")
    (two / "first/report.html").symlink_to("../kept.html")
    (tmp_path / "linked").symlink_to(two)
    assert Studio(tmp_path / "linked").answer("/report", {"of": ["first"]}) is not None


DAMAGE = {
    "a duration beyond floats": lambda record: record.update(duration_s=10**400),
    "a duration of infinity": lambda record: record.update(duration_s=float("inf")),
    "a duration in words": lambda record: record.update(duration_s="long"),
    "pulses that are no number": lambda record: record["pulses"].update(total=float("nan")),
    "pulses beyond all differences": lambda record: record["pulses"].update(total=10**308),
    "pulses as a list": lambda record: record["pulses"].update(total=[1]),
    "a clock beyond floats": lambda record: record["pulses"].update(clock_hz=10**400),
    "a stated duration beyond floats": lambda record: record["request"].update(duration_s=10**400),
    "a share beyond floats": lambda record: record.update(
        lower_bound={"duration_s": 1.0, "gap": 10**400}
    ),
    "a fit beyond floats": lambda record: record["inputs"].update(fit_m=10**400),
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_a_damaged_record_is_left_out_and_the_others_are_listed(two, directory, damage):
    copytree(directory, two / "third")
    path = two / "first/plan.json"
    record = json.loads(path.read_text(encoding="utf-8"))
    damage(record)
    path.write_text(json.dumps(record), encoding="utf-8")
    assert [one.name for one in PlanList(two).find()] == ["deep/er/second <b>", "third"]
    studio = Studio(two)
    assert page_of(studio, "third", "deep/er/second <b>").count("<iframe") == 2
    assert "Not here: first." in page_of(studio, "first")


def ask(address, request):
    """All that comes back for the bytes of a request."""
    port = int(address.rstrip("/").rsplit(":", 1)[1])
    with socket.create_connection(("127.0.0.1", port), timeout=10) as visitor:
        visitor.sendall(request)
        answer = b""
        while data := visitor.recv(1 << 16):
            answer += data
    return answer


@pytest.mark.parametrize("target", ["http://[/", "http://[::1/report"])
def test_an_address_that_is_none_is_refused_quietly(two, capsys, target):
    with serve_pages(Studio(two).answer) as address:
        answer = ask(address, f"GET {target} HTTP/1.0\r\nHost: localhost\r\n\r\n".encode())
    assert answer.split(b"\r\n")[0].split()[1] == b"400"
    assert capsys.readouterr().err == ""


def test_a_browser_that_resets_the_connection_leaves_no_traceback(two, capsys):
    """Before its request is whole, and before the answer has come."""
    with serve_pages(Studio(two).answer) as address:
        port = int(address.rstrip("/").rsplit(":", 1)[1])
        for request in (
            b"GET /",
            b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n",
            b"GET http://[/ HTTP/1.1\r\n\r\n",
        ):
            for _ in range(5):
                with socket.create_connection(("127.0.0.1", port)) as visitor:
                    visitor.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                    visitor.sendall(request)
        assert (
            b" 200 " in ask(address, b"GET / HTTP/1.0\r\nHost: localhost\r\n\r\n").split(b"\r\n")[0]
        )
        time.sleep(0.2)
    assert capsys.readouterr().err == ""


def test_headers_keep_reports_to_themselves(two):
    with serve_pages(Studio(two).answer) as address:
        with urlopen(address + "report?of=first", timeout=10) as answer:
            policy = answer.headers["Content-Security-Policy"]
            assert answer.headers["X-Content-Type-Options"] == "nosniff"
        with urlopen(address, timeout=10) as answer:
            assert answer.headers["X-Content-Type-Options"] == "nosniff"
        with pytest.raises(HTTPError) as refused:
            urlopen(address + "report?of=none", timeout=10)
        assert refused.value.headers["X-Content-Type-Options"] == "nosniff"
        refused.value.close()
    assert policy == REPORT_POLICY
    rules = [rule.strip() for rule in policy.split(";")]
    assert rules[0] == "sandbox allow-scripts"
    assert set(rules) >= {
        rule.strip() for rule in POLICY.split(";")
    }  # what the player of a report needs


class Visited:
    """A studio whose pages have scripts of the test; those in its own page say things by asking for
    /said.
    """

    def __init__(self, studio, in_studio="", in_report=""):
        self.said, self._studio = Queue(), studio
        self.added = {"/": in_studio, "/report": in_report}

    def answer(self, path, query):
        if path == "/said":
            self.said.put(query["text"][0])
            return PAGE, b""
        answer = self._studio.answer(path, query)
        if answer is None or path not in self.added:
            return answer
        kind, content = answer
        script = f"<script>{self.added[path]}</script></body>".encode()
        return kind, content.replace(b"</body>", script)


PASS_ON = 'addEventListener("message", event => { if (event.data?.said) fetch("/said?text=" + event.data.said); });'
"""In the studio's page: what a report says to it."""


@needs_browser
def test_the_script_of_a_report_reads_nothing_and_sends_nothing(two, tmp_path):
    (two / "deep/er/second <b>/report.html").write_text("<body>secret", encoding="utf-8")
    elsewhere = Queue()
    with serve_pages(lambda path, query: elsewhere.put(path)) as other:
        report = """<body><script>(async () => {
          const tries = {
            report: async () => (await fetch("/report?of=" + encodeURIComponent("deep/er/second <b>"))).text(),
            list: async () => (await fetch("/")).text(),
            parent: async () => parent.document.body.textContent,
            storage: async () => localStorage.length,
            elsewhere: async () => (await fetch("OTHER", { mode: "no-cors" })).type,
            image: () => new Promise((done, fail) => Object.assign(
              new Image(), { onload: done, onerror: fail, src: "OTHERx.png" })),
            frame: async () => document.body.append(Object.assign(document.createElement("iframe"), { src: "OTHER" })),
            script: () => new Promise((done, fail) => document.body.append(
              Object.assign(document.createElement("script"), { onload: done, onerror: fail, src: "OTHERx.js" }))),
            popup: async () => open("OTHER").name,
          };
          const through = [];
          for (const [name, attempt] of Object.entries(tries)) try { await attempt(); through.push(name); } catch {}
          setTimeout(() => parent.postMessage({ said: "through " + through }, "*"), 500);
        })();</script></body>""".replace("OTHER", other)
        (two / "first/report.html").write_text(report, encoding="utf-8")
        visited = Visited(Studio(two), PASS_ON)
        with serve_pages(visited.answer) as address, visit(tmp_path, address + "?show=first"):
            assert (
                visited.said.get(timeout=60) == "through frame"
            )  # of which nothing is loaded, as is seen next
    assert elsewhere.empty()


@needs_browser
def test_a_report_reloads_where_it_was_read_and_its_machine_is_drawn(call, tmp_path):
    """In the sandbox, too: the player of the machine, and the place when the report is written
    again.
    """
    line = tmp_path / "line.toml"
    line.write_text(
        'schema = 1\nlength = "mm"\n[[segment]]\nline = { to = [0, 0, 0.1] }\n', encoding="utf-8"
    )
    out = tmp_path / "plans/line"
    few = ("--order", 2, "--no-worth", "--no-baselines")
    assert call("plan", line, "--machine", "hexapod", "--out", out, *few).exit_code == 0
    in_report = """
      const say = said => parent.postMessage({ said }, "*");
      let state = FIRST;
      addEventListener("scroll", () => { if (state !== "playing") say("at " + Math.round(scrollY)); });
      addEventListener("message", event => {
        if (state !== "playing" || event.source === parent || typeof event.data?.time !== "number") return;
        state = "played";
        say(state);
        scrollTo(0, 700);
      });
      const button = document.querySelector("#space button");
      if (state === "playing") setTimeout(() => { button.scrollIntoView(); button.click(); }, 500);
    """
    visited = Visited(Studio(tmp_path / "plans"), PASS_ON, in_report.replace("FIRST", '"playing"'))
    with serve_pages(visited.answer) as address, visit(tmp_path, address + "?show=line"):
        assert visited.said.get(timeout=60) == "played"
        assert visited.said.get(timeout=60) == "at 700"
        visited.added["/report"] = in_report.replace("FIRST", '"rewritten"')
        os.utime(out / "plan.json", ns=(10**18, 10**18))
        assert visited.said.get(timeout=60) == "at 700"


def test_the_stamp_changes_when_a_plan_is_written_again_and_only_then(two):
    studio = Studio(two)
    before = studio.answer("/stamp", {})
    assert studio.answer("/stamp", {}) == before
    record = two / "first/plan.json"
    os.utime(record, ns=(10**18, 10**18))
    after = studio.answer("/stamp", {})
    assert after != before
    for file in (two / "first").iterdir():
        if file.is_file():
            file.unlink()
    assert studio.answer("/stamp", {}) not in (before, after)


@pytest.fixture
def serving(two):
    """The address at which two plans are served, and the process."""
    command = [sys.executable, "-m", "pulsepath", "studio", str(two), "--no-browser"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        yield process.stdout.readline().strip(), process
        process.kill()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no SIGINT to one process")
def test_it_is_served_on_loopback_alone_until_ctrl_c(serving):
    address, process = serving
    with urlopen(address + "report?of=" + quote("deep/er/second <b>"), timeout=10) as answer:
        assert b"bare-circle" in answer.read()
    request = Request(address, headers={"Host": "elsewhere.example"})
    with pytest.raises(HTTPError) as refused:
        urlopen(request, timeout=10)
    assert refused.value.code == 403
    refused.value.close()
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=20)
    assert process.returncode == 0
    assert said.endswith("stopped\n")


def test_bad_calls(call, tmp_path):
    program = tmp_path / "a.toml"
    program.write_text("", encoding="utf-8")
    for arguments, told in [
        ([tmp_path / "none"], "no such folder"),
        ([tmp_path, "--machine", "hexapod"], "--machine needs --program"),
        ([tmp_path, "--program", tmp_path / "none.toml"], "No such file"),
        ([tmp_path, "--program", program, "--options", "--out x"], "--out cannot stand here"),
        ([tmp_path, "--program", program, "--options", "circle"], "circle cannot stand here"),
        ([tmp_path, "--program", program, "--options", '"'], "No closing quotation"),
    ]:
        done = call("studio", *arguments, "--no-browser")
        assert done.exit_code == 2, arguments
        assert told in done.stderr


def wait_for(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not come"
        time.sleep(0.05)


def test_a_program_that_is_saved_is_planned_again(tmp_path):
    """A refusal is shown as it is; what is mended is planned, into the folder of the program's
    name.
    """
    program, folder = tmp_path / "part.toml", tmp_path / "out"
    text = 'schema = 1\nmachine = "{}"\n[[segment]]\nline = {{ to = ["4 mm", "0 mm", "0 mm"] }}\n'
    program.write_text(text.format("nobody"), encoding="utf-8")
    with Replanner(program, None, ["--no-figures"], folder) as replanner:
        studio = Studio(folder, replanner)
        wait_for(lambda: replanner.refused)
        assert "nobody" in page_of(studio)
        program.write_text(text.format("traverser"), encoding="utf-8")
        wait_for(lambda: (folder / "part/plan.json").exists() and not replanner.state)
    page = page_of(studio, "part")
    assert "part on traverser" in page
    assert page.count("<iframe") == 1


def test_the_machine_that_a_program_names_is_watched(tmp_path):
    program, machine = tmp_path / "part.toml", tmp_path / "mine.toml"
    machine.write_text("kind = 1\n", encoding="utf-8")
    program.write_text(
        'schema = 1\nmachine = "mine.toml"\n[[segment]]\ndwell = "1 s"\n', encoding="utf-8"
    )
    with Replanner(program, None, [], tmp_path / "out") as replanner:
        wait_for(lambda: replanner.refused)
        first = replanner.state
        machine.write_text("kind = 2 # saved\n", encoding="utf-8")
        wait_for(lambda: replanner.refused and replanner.state != first)
    assert "mine.toml" in replanner.state
