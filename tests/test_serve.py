"""The service, over HTTP: most of it in a process of its own, as users start it."""

import asyncio
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest

from jaxpack.io.jobs import job_from_columns
from jaxpack.io.plans import read_plan_json
from jaxpack.model.plan_check import check_plan

BINS = [{"X": 10, "Y": 10, "Z": 10}]
NASTY = "</script><img src=x onerror=alert(1)> & \ud800 \r\nX-Evil: 1"


def order(**more):
    return {"items": [{"X": 5, "Y": 5, "Z": 5, "COPIES": 8, "NAME": "cube"}], "bins": BINS, **more}


class Service:
    """`jaxpack serve` as a process."""

    def __init__(self, *options):
        command = [sys.executable, "-m", "jaxpack", "serve", "--port", "0", *options]
        environment = os.environ | {"COLUMNS": "80"}
        self.process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment)
        self.line = self.process.stderr.readline()
        self.http = httpx.Client(base_url=self.line.split(",")[0], timeout=60)

    def __enter__(self):
        for _ in range(240):
            if self.http.get("/readyz").status_code == 200:
                return self
            time.sleep(0.25)
        raise AssertionError("it is not ready after a minute")

    def __exit__(self, *_):
        self.http.close()
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self.process.stderr.close()

    def post(self, data, path="/v1/solve", **more):
        body = data if isinstance(data, bytes) else json.dumps(data).encode()
        headers = {"Content-Type": "application/json", **more}
        return self.http.post(path, content=body, headers=headers)

    def workers(self):
        command = ["ps", "-ww", "-o", "pid=,args=", "--ppid", str(self.process.pid)]
        rows = subprocess.run(command, capture_output=True, text=True).stdout.splitlines()
        return [int(row.split()[0]) for row in rows if "spawn_main" in row]


LIMITS = ("--items", "50", "--orders", "3", "--body", "20000", "--queue", "4", "--deadline", "5")


@pytest.fixture(scope="module")
def service():
    with Service("--workers", "1", *LIMITS) as one:
        yield one


def is_problem(answer, status):
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    fields = answer.json()
    assert fields["status"] == status
    assert fields["title"]
    assert fields["detail"].isprintable()
    return fields


def test_an_order_comes_back_as_a_plan_that_is_valid_and_can_be_read(service, tmp_path):
    columns = {"X": [5, 2], "Y": [5, 2], "Z": [5, 2], "COPIES": [7, 8]}
    answer = service.post(
        {"items": columns, "bins": {"X": [10], "Y": [10], "Z": [10]}, "name": "a"}
    )
    assert answer.status_code == 200
    plan = answer.json()
    assert (plan["job"], plan["status"], len(plan["bins"])) == ("a", "optimal", 1)
    assert len(plan["bins"][0]["items"]) == 15
    path = tmp_path / "plan.json"
    path.write_bytes(answer.content)
    job = job_from_columns(columns, BINS, "a")
    check_plan(job, read_plan_json(path, job))


def test_options_are_obeyed(service):
    assert service.post(order(options={"objective": "height", "seed": 3})).status_code == 200
    bare = order(options={"packings": 2, "support": 1.0, "time_limit": 1e9})
    assert service.post(bare).status_code == 200
    large = order(options={"skip_unfit": True})
    large["items"].append({"X": 50, "Y": 5, "Z": 5})
    assert service.post(large).json()["left_out"] == [{"item": 1, "name": ""}]
    del large["options"]
    assert "option skip_unfit" in is_problem(service.post(large), 422)["detail"]


def test_a_bad_order_of_several_stops_no_other(service):
    items = order()["items"]
    bad = [{"X": 5, "Y": "wide", "Z": 5}]
    orders = [{"name": "1", "items": items}, {"items": bad}, {"name": "3", "items": items}]
    answer = service.post({"bins": BINS, "orders": orders}, "/v1/solve-many")
    assert answer.status_code == 200
    first, second, third = answer.json()
    assert (first["job"], third["job"]) == ("1", "3")
    assert (second["status"], second["row"], second["column"]) == (422, 0, "Y")
    many = {"bins": BINS, "orders": orders + orders}
    assert "orders" in is_problem(service.post(many, "/v1/solve-many"), 422)["detail"]
    assert service.post({"bins": BINS, "orders": []}, "/v1/solve-many").json() == []
    assert [one["status"] for one in service.post(
        {"orders": [{"items": items}, 5]}, "/v1/solve-many").json()] == [422, 422]  # fmt: skip


DEEP = b'{"items": ' + b"[" * 15000
ITEM = '{"items": [{"X": %s, "Y": 5, "Z": 5}], "bins": [{"X": 10, "Y": 10, "Z": 10}]}'


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b"", 400),
        (b"{", 400),
        (b"\xff", 400),
        (DEEP, 400),
        ((ITEM % "NaN").encode(), 400),
        ((ITEM % "-Infinity").encode(), 400),
        ((ITEM % ("9" * 5000)).encode(), 400),
        (b'{"items": [], "items": []}', 400),
        (b"5", 422),
        (b"[]", 422),
        (b"{}", 422),
        (b'{"items": 5, "bins": 6}', 422),
        (b'{"items": "", "bins": ""}', 422),
        (b'{"items": [], "bins": []}', 422),
        (b'{"items": [[1]], "bins": [[1]]}', 422),
        (b'{"items": {"X": 5}, "bins": {"X": "5"}}', 422),
        ((ITEM % "1e999").encode(), 422),
        ((ITEM % "1e300").encode(), 422),
        ((ITEM % ("9" * 400)).encode(), 422),
        ((ITEM % "true").encode(), 422),
        ((ITEM % ("[" * 800 + "]" * 800)).encode(), 422),
        (json.dumps(order(more=1)).encode(), 422),
        (json.dumps(order(name=5)).encode(), 422),
        (json.dumps(order(options={"seed": -1})).encode(), 422),
        (json.dumps(order(options={"seed": 1.5})).encode(), 422),
        (json.dumps(order(options={"time_limit": 0})).encode(), 422),
        (json.dumps(order(options={"packings": 10**30})).encode(), 200),
        (json.dumps(order(options={"objective": "fun"})).encode(), 422),
        (json.dumps(order(options={"support": 2})).encode(), 422),
        (b'"' + b"x" * 30000 + b'"', 413),
        (json.dumps({"items": [{"X": 1, "Y": 1, "Z": 1}] * 60, "bins": BINS}).encode(), 422),
        ((ITEM % '5, "COPIES": 51').encode(), 422),
        ((ITEM % '5, "COPIES": 1e9').encode(), 422),
    ],
)  # fmt: skip
@pytest.mark.parametrize("path", ["/v1/solve", "/v1/solve-many"])
def test_what_is_wrong_is_said_and_never_a_fault(service, path, body, status):
    if path == "/v1/solve-many" and status not in (400, 413):
        answer = service.post(b'{"orders": [' + body + b"]}", path)
        (one,) = answer.json()
        assert one["status"] in (422, "optimal")
    elif status == 200:
        assert service.post(body, path).status_code == 200
    else:
        is_problem(service.post(body, path), status)


@pytest.mark.parametrize("depth", [900, 5000, 9000])
def test_lists_in_lists_are_refused_however_deep(service, depth):
    # How deep `json` reads differs from Python to Python (3.12: 3,000; 3.13: 10,000).
    nested = b"[" * depth + b"]" * depth
    answer = service.post(b'{"bins": [], "items": ' + nested + b"}")
    is_problem(answer, answer.status_code)
    assert answer.status_code in (400, 422)
    assert len(answer.text) < 1000


def test_the_line_names_row_and_column(service):
    items = [{"X": 5, "Y": 5, "Z": 5}, {"X": 5, "Y": 5, "Z": -1}]
    fields = is_problem(service.post({"items": items, "bins": BINS}), 422)
    assert (fields["row"], fields["column"]) == (1, "Z")
    fields = is_problem(service.post({"items": [{"X": 50, "Y": 5, "Z": 5}], "bins": BINS}), 422)
    assert fields["row"] == 0
    assert "column" not in fields


def test_what_is_no_json_or_no_address_is_refused(service):
    is_problem(service.post(order(), **{"Content-Type": "text/plain"}), 415)
    is_problem(service.http.get("/nowhere"), 404)
    is_problem(service.http.get("/v1/plans/unknown.html"), 404)
    is_problem(service.http.get("/v1/solve"), 405)


def test_the_page_of_a_plan_can_do_nothing_and_names_in_it_are_text(service):
    asked = order(name=NASTY.replace("\ud800", ""))
    asked["items"][0]["NAME"] = NASTY
    answer = service.post(asked)
    plan = answer.json()
    assert plan["job"] == asked["name"]
    assert plan["bins"][0]["items"][0]["name"] == NASTY
    page = service.http.get(plan["page"])
    assert page.status_code == 200
    assert page.headers["content-security-policy"].startswith("sandbox ")
    assert "<img" not in re.sub(r"<script>.*?</script>", "", page.text, count=1, flags=re.DOTALL)
    assert len(plan["id"]) >= 20
    assert plan["id"] != service.post(asked).json()["id"]
    assert "x-evil" not in page.headers


def test_what_it_serves_comes_from_nowhere_else(service):
    for path in ("/", "/docs"):
        answer = service.http.get(path)
        assert answer.status_code == 200
        assert "default-src 'none'" in answer.headers["content-security-policy"]
        assert "//" not in answer.text.replace("<!doctype", "")
        for part in re.findall(r'(?:src|href)="(/[^"]+)"', answer.text):
            assert service.http.get(part).status_code == 200, part
    described = service.http.get("/openapi.json").json()
    for path in ("/v1/solve", "/v1/solve-many"):
        content = described["paths"][path]["post"]["requestBody"]["content"]["application/json"]
        example = dict(content["example"])
        assert service.post(example, path).status_code == 200


def test_it_counts(service):
    service.post(order())
    text = service.http.get("/metrics").text
    assert 'jaxpack_requests_total{route="/v1/solve",status="200"}' in text
    assert 'jaxpack_request_seconds_bucket{le="0.15",route="/v1/solve"}' in text
    assert re.search(r"^jaxpack_queue 0\.0$", text, re.MULTILINE)
    for name in ("jaxpack_orders_packed_total", "jaxpack_bins_used_total"):
        assert float(re.search(rf"^{name} (.+)$", text, re.MULTILINE)[1]) >= 1
    assert service.http.get("/healthz").json() == {"status": "ok"}


HARD = {
    "items": [{"X": 3 + n % 5, "Y": 2 + n % 3, "Z": 4 + n % 4} for n in range(50)],
    "bins": BINS,
}


def slow(seconds):
    return HARD | {"options": {"time_limit": seconds}}


def test_a_full_queue_says_when_to_come_again(service):
    with ThreadPoolExecutor(12) as threads:
        answers = list(threads.map(service.post, [slow(1.0)] * 12))
    statuses = {answer.status_code for answer in answers}
    assert statuses == {200, 429}
    refused = next(answer for answer in answers if answer.status_code == 429)
    is_problem(refused, 429)
    assert int(refused.headers["retry-after"]) >= 1


def served(service):
    """The answer to an order, asked again as long as it is told to come again."""
    end = time.monotonic() + 60
    while True:
        answer = service.post(order())
        if answer.status_code not in (503, 504) or time.monotonic() > end:
            return answer
        time.sleep(0.2)


@pytest.mark.long
def test_a_worker_that_dies_is_replaced(service):
    (worker,) = service.workers()
    with ThreadPoolExecutor(1) as threads:
        os.kill(worker, signal.SIGSTOP)
        waiting = threads.submit(service.post, order())
        time.sleep(1)
        os.kill(worker, signal.SIGKILL)
        answer = waiting.result()
    is_problem(answer, 503)
    assert int(answer.headers["retry-after"]) >= 1
    assert served(service).status_code == 200
    (other,) = service.workers()
    assert other != worker
    os.kill(other, signal.SIGKILL)  # while it has nothing to do
    assert served(service).status_code == 200


@pytest.mark.long
def test_a_deadline_is_kept_while_a_worker_hangs_or_a_body_is_late(service):
    (worker,) = service.workers()
    os.kill(worker, signal.SIGSTOP)
    is_problem(service.post(order()), 504)  # it would hang for ever
    assert served(service).status_code == 200  # by another one

    def late():
        yield b"{"
        time.sleep(6)
        yield b"}"

    headers = {"Content-Type": "application/json"}
    is_problem(service.http.post("/v1/solve", content=late(), headers=headers), 504)


def test_requests_that_come_together_share_a_run(monkeypatch):
    from jaxpack.service import workers
    from jaxpack.service.limits import Limits
    from jaxpack.service.packing import Reply, Request

    waves = []

    class Counting:
        def __init__(self, limits):
            self.process = type("Process", (), {"pid": 1, "is_alive": lambda self: True})()
            self.connection = type("Connection", (), {"recv": lambda self: "ready"})()

        def run(self, wave, asking, tell):
            waves.append((len(wave), asking))
            for number, request in enumerate(wave):
                tell(number, Reply(200, request.body))

        def close(self):
            pass

    async def ask():
        async with workers.Workers(Limits(gather=0.2)) as some:
            return await asyncio.gather(*(some.ask(Request(False, b"%d" % n)) for n in range(5)))

    monkeypatch.setattr(workers, "Worker", Counting)
    assert [reply.body for reply in asyncio.run(ask())] == [b"%d" % n for n in range(5)]
    assert waves == [(5, 5)]


def test_orders_beside_each_other_get_the_plans_of_their_own(service):
    assert served(service).status_code == 200
    asked = [order(name=str(n)) for n in range(4)]
    for n, one in enumerate(asked):
        one["items"][0]["COPIES"] = n + 1
    with ThreadPoolExecutor(4) as threads:
        plans = [answer.json() for answer in threads.map(service.post, asked)]
    assert [plan["job"] for plan in plans] == ["0", "1", "2", "3"]
    assert [len(plan["bins"][0]["items"]) for plan in plans] == [1, 2, 3, 4]


def test_old_pages_make_room():
    from jaxpack.service.packing import Page
    from jaxpack.service.pages import Pages

    pages = Pages(20)
    for name in "abc":
        pages.keep({name: Page("", "x" * 8)})
        pages.get("a")
    assert [bool(pages.get(name)) for name in "abc"] == [True, False, True]


def test_sigterm_finishes_what_runs_and_refuses_what_comes():
    with Service("--workers", "1") as service, ThreadPoolExecutor(1) as threads:
        (worker,) = service.workers()
        os.kill(worker, signal.SIGSTOP)
        waiting = threads.submit(service.post, order())
        time.sleep(0.7)
        service.process.send_signal(signal.SIGTERM)
        os.kill(worker, signal.SIGTERM)  # as a supervisor does that ends a group
        time.sleep(0.7)
        with pytest.raises(httpx.ConnectError), httpx.Client() as other:
            other.get(str(service.http.base_url))
        os.kill(worker, signal.SIGCONT)
        assert waiting.result().status_code == 200
        assert service.process.wait(20) == 0
        assert service.process.stderr.read() == ""
        assert service.line.startswith("http://127.0.0.1:")


@pytest.mark.parametrize(
    ("options", "start"),
    [
        (("--workers", "0"), "--workers 0"),
        (("--port", "70000"), "--port 70000"),
        (("--time-limit", "0"), "--time-limit 0"),
        (("--host", "no.such.host.invalid"), "--host no.such.host.invalid"),
    ],
)
def test_an_option_that_is_off_is_one_line(options, start):
    command = [sys.executable, "-m", "jaxpack", "serve", *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert done.stderr.startswith(f"error: {start}")
    assert done.stderr.count("\n") == 1


def test_a_port_that_is_taken_is_one_line():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        command = [sys.executable, "-m", "jaxpack", "serve", "--port", str(taken.getsockname()[1])]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert "in use" in done.stderr


def test_without_the_extra_a_line_says_what_to_install():
    lines = "import sys; sys.modules['fastapi'] = None; sys.argv[1:] = ['serve', '--port', '0']"
    start = f"{lines}; from jaxpack.__main__ import main; main()"
    done = subprocess.run([sys.executable, "-c", start], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == "error: fastapi is not installed: pip install 'jaxpack[serve]'\n"


def drop(page, where, path):
    """Drags a file of the desktop over a place of the page and lets it go there."""
    box, session = page.locator(where).bounding_box(), page.context.new_cdp_session(page)
    at = {"x": box["x"] + box["width"] / 2, "y": box["y"] + box["height"] / 2}
    data = {"items": [], "files": [str(path)], "dragOperationsMask": 1}
    for kind in ("dragEnter", "dragOver", "drop"):
        if kind == "drop":
            assert page.locator(".over").count() == 1
        session.send("Input.dispatchDragEvent", {"type": kind, "data": data, **at})


@pytest.mark.slow
def test_files_that_are_dropped_on_the_page_are_packed_shown_and_saved(service, tmp_path):
    from playwright.sync_api import sync_playwright

    (tmp_path / "items.csv").write_text("X,Y,Z,COPIES,NAME\n5,5,5,9,cube\n")
    (tmp_path / "bins.csv").write_text("X,Y,Z\n10,10,10\n")
    (tmp_path / "other.csv").write_text("X,Y,Z,COPIES\n5,5,5,3\n")
    wrong = []
    with sync_playwright() as playwright:
        options = {"args": ["--enable-unsafe-swiftshader"]}
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), **options)
        page = browser.new_page()
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.goto(str(service.http.base_url))
        drop(page, ".drop:has(#bins)", tmp_path / "bins.csv")
        drop(page, ".drop:has(#items)", tmp_path / "items.csv")
        assert page.locator(".over").count() == 0
        page.click("button")
        page.locator("#said").filter(has_text="2 bins; lower bound 2").wait_for()
        frame = page.frame_locator("#plan")
        frame.locator("#plot canvas").first.wait_for()
        assert frame.locator("#count").text_content() == "9 of 9"
        inside = page.frames[1]
        assert inside.evaluate("jaxpack.shown()") == list(range(1, 10))
        for link, name in (("#json", "plan.json"), ("#html", "plan.html")):
            with page.expect_download() as download:
                page.click(link)
            assert download.value.suggested_filename == name
            assert b"cube" in download.value.path().read_bytes()
        drop(page, "h1", tmp_path / "other.csv")  # beside both: it is not opened, it is the items
        page.click("button")
        page.locator("#said").filter(has_text="1 bin; lower bound 1").wait_for()
        browser.close()
    assert wrong == []


@pytest.mark.slow
def test_the_page_packs_files_and_shows_the_plan(service, tmp_path):
    from playwright.sync_api import sync_playwright

    (tmp_path / "items.csv").write_text(f'X;Y;Z;COPIES;NAME\n2,5;5;5;4;"{NASTY[:30]}"\n')
    (tmp_path / "bins.csv").write_text("X,Y,Z\n10,10,10\n")
    wrong, asked = [], []
    with sync_playwright() as playwright:
        options = {"args": ["--enable-unsafe-swiftshader"]}
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), **options)
        page = browser.new_page()
        page.on("request", lambda request: asked.append(request.url))
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("dialog", lambda dialog: (wrong.append(dialog.message), dialog.dismiss()))
        page.on("console", lambda said: wrong.append(said.text) if said.type == "error" else None)
        base = str(service.http.base_url)
        page.goto(base)
        page.set_input_files("#items", tmp_path / "items.csv")
        page.click("button")
        page.wait_for_selector("#said.wrong")
        for side in "XYZ":
            page.fill(f"#{side}", "10")
        page.click("button")
        page.wait_for_selector("#plan:not([hidden])")
        assert page.locator("#said").text_content() == "1 bin; lower bound 1"
        frame = page.frame_locator("#plan")
        frame.locator("#count").wait_for()
        assert frame.locator("#count").text_content() == "4 of 4"
        assert frame.locator("img").count() == 0
        with page.expect_download() as download:
            page.click("#json")
        assert len(json.loads(download.value.path().read_text())["bins"]) == 1
        page.set_input_files("#bins", tmp_path / "bins.csv")
        page.click("button")
        page.locator("#said").filter(has_text="1 bin;").wait_for()
        assert {url.split("/")[2] for url in asked if url.startswith("http")} == {
            base.split("/")[2]
        }
        assert wrong == []
        page.goto(f"{base}/docs")
        page.get_by_text("/v1/solve-many").first.wait_for()
        browser.close()
    assert wrong == []
