"""Runs on data and into stores of a server must equal runs of this machine, with the bytes of the trials' chunks alone."""

import atexit
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

from server import Proxy, Server

ATSPLAT, OBJECTS, SCRATCH = sys.argv[1], sys.argv[2], Path(sys.argv[3])
NEAREST = Path(__file__).resolve().parents[2] / "methods" / "nearest.py"
SECRET = "SecretThatMustNotShow"
SCENES = 8
FRAMES = 24
LIMIT = 3
TABLES = ["targets.parquet", "trials.parquet"]
METHODS = ["--method", "warp", "--method", "nearest-view"]


def environment(url):
    kept = {name: value for name, value in os.environ.items() if not name.startswith("AWS_")}
    aws = {"ENDPOINT": url, "ALLOW_HTTP": "true", "REGION": "us-east-1", "ACCESS_KEY_ID": "test", "SECRET_ACCESS_KEY": SECRET}
    return kept | {f"AWS_{name}": value for name, value in aws.items()} | {"ATSPLAT_OBJECTS": OBJECTS}


def start(*arguments, url):
    command = [ATSPLAT, "--threads", "2", *map(str, arguments)]
    return subprocess.Popen(command, env=environment(url), cwd=SCRATCH, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def finish(process, code=0):
    """The process's standard error."""
    output, errors = process.communicate(timeout=300)
    assert process.returncode == code, f"expected exit code {code}, found {process.returncode}: {output}\n{errors}"
    assert SECRET not in output + errors
    return errors


def atsplat(*arguments, url="http://127.0.0.1:9", code=0):
    return finish(start(*arguments, url=url), code)


def run(data, out, *more, cache="cache", methods=METHODS, **how):
    limit = [] if "--shard" in more else ["--limit", LIMIT]
    copies = ["--cache", cache] if "://" in f"{data} {out}" else []
    return atsplat("run", "rooms-2v-128", "--data", data, *methods, "--out", out, *copies, *limit, *more, **how)


def exchanged(errors, url):
    """Requests, bytes read and bytes written below a URL."""
    found = re.findall(rf"object storage: (\d+) requests, (\d+) bytes read, (\d+) bytes written \({re.escape(url)}\)", errors)
    assert len(found) == 1, errors
    return tuple(map(int, found[0]))


def same_rows(ours, theirs):
    for table in TABLES:
        assert (SCRATCH / ours / table).read_bytes() == (SCRATCH / theirs / table).read_bytes(), f"{table} of {ours} and {theirs}"


def said(text):
    print(text, flush=True)


# Eight scenes in as many chunks, of which the runs need three.
simulate = ["data", "simulate", "--size", "128x128", "--samples", 1, "--frames", FRAMES]
atsplat(*simulate, "rooms", "--scenes", SCENES)
atsplat("data", "export", "rooms/test", "chunks", "--chunks", "--chunk-bytes", 1)
keys = sorted(json.loads((SCRATCH / "chunks/index.json").read_text()))
assert len(keys) == SCENES
entry = {"context": [2, 20], "target": [3, 9, 15]}
(SCRATCH / "chunks/evaluation_index.json").write_text(json.dumps({key: entry for key in keys}))
chunk_of = json.loads((SCRATCH / "chunks/index.json").read_text())
used = [chunk_of[keys[at * SCENES // LIMIT]] for at in range(LIMIT)]
needed = sum((SCRATCH / "chunks" / chunk).stat().st_size for chunk in used)
everything = sum(path.stat().st_size for path in (SCRATCH / "chunks").iterdir())
assert everything > 2 * needed

server = Server()
atexit.register(server.stop)
server.client.create_bucket(Bucket="lab")
server.upload(SCRATCH / "chunks", "lab", "rooms")
server.upload(SCRATCH / "rooms/test", "lab", "frames")
DATA, STORES = "s3://lab/rooms", "s3://lab/stores"

# Equal rows, from as many bytes as the chunks have.
run("chunks", "here/store")
proxy = Proxy(server)
requests, read, _ = exchanged(run(DATA, "there/store", url=proxy.url), DATA)
same_rows("here/store", "there/store")
assert needed <= read <= 1.05 * needed and proxy.answered <= 1.2 * needed, (read, proxy.answered, needed)
said(f"{LIMIT} of {SCENES} chunks, {needed} bytes: {requests} requests read {read} bytes, the server sent {proxy.answered} "
     f"({proxy.answered / needed:.3f} times the chunks); the dataset has {everything}")
for name in ["here", "there"]:
    atsplat("report", f"{name}/store", "--out", f"{name}/page")
tables = sorted(path.name for path in (SCRATCH / "here/page/tables").glob("*.csv"))
assert tables and all((SCRATCH / "here/page/tables" / name).read_bytes() == (SCRATCH / "there/page/tables" / name).read_bytes() for name in tables)
said(f"equal rows and {len(tables)} equal tables")

# What was read once is not read again; another part reads its own chunks.
assert exchanged(run(DATA, "again", url=proxy.url), DATA)[1] == 0
shard = run(DATA, "shard", "--shard", "2/4", cache="other", url=proxy.url)
assert exchanged(shard, DATA)[1] <= 1.05 * sum((SCRATCH / "chunks" / chunk_of[key]).stat().st_size for key in keys[2:4])

# Folders of scenes: the images of a trial's scenes, and the trajectories that say what the folder holds.
frames = sum(path.stat().st_size for key in keys[:1] for path in (SCRATCH / "rooms/test" / key).iterdir())
lists = sum(path.stat().st_size for path in (SCRATCH / "rooms/test").glob("*.txt"))
one = ["--index", SCRATCH / "chunks/evaluation_index.json", "--shard", f"1/{SCENES}"]
read = exchanged(run("s3://lab/frames", "frames", *one, url=proxy.url), "s3://lab/frames")[1]
assert read <= frames + lists, (read, frames, lists)
run("rooms/test", "frames-here", *one)
same_rows("frames-here", "frames")
said("folders of scenes: equal rows, from the images of one scene")

# A server that dies in the middle of the second chunk, and a run that resumes.
dying = Proxy(server, dies_after=int(1.5 * needed / LIMIT))
began = time.monotonic()
errors = run(DATA, "resumed", cache="resumed-cache", url=dying.url, code=1)
assert DATA in errors and "the same command resumes it" in errors, errors
said(f"a server that dies is an error after {time.monotonic() - began:.0f} s: {errors.splitlines()[-1][:160]}…")
read = exchanged(run(DATA, "resumed", cache="resumed-cache", url=proxy.url), DATA)[1]
assert read <= needed, (read, needed)
same_rows("here/store", "resumed")

# Answers that break off, a bucket and a folder that are missing.
errors = run(DATA, "cut", cache="cut-cache", url=Proxy(server, cuts_after=20_000).url, code=1)
assert f"{DATA}/" in errors, errors
for url in ["s3://nobody/rooms", "s3://lab/room"]:
    errors = run(url, "none", url=proxy.url, code=1)
    assert f"{url}: expected an object or a folder of objects" in errors, errors
server.client.put_object(Bucket="lab", Key="damaged/index.json", Body=json.dumps(chunk_of).encode())
for chunk in set(chunk_of.values()):
    body = (SCRATCH / "chunks" / chunk).read_bytes()
    server.client.put_object(Bucket="lab", Key=f"damaged/{chunk}", Body=body[: len(body) // 2])
errors = run("s3://lab/damaged", "damaged", "--index", SCRATCH / "chunks/evaluation_index.json", url=proxy.url, code=1)
assert "nothing was evaluated" in errors, errors
said("answers that break off, missing buckets and folders, damaged chunks: errors that name them")

# A chunk that changes is noticed: it alone is read, and the results of the old one are replaced.
chunk = used[1]
shutil.copytree(SCRATCH / "chunks", SCRATCH / "changed")
position = keys.index(next(key for key in keys if chunk_of[key] == chunk))
atsplat(*simulate, "plain", "--scenes", f"{position}..{position + 1}", "--effects", "none")
atsplat("data", "export", "plain/test", "plain-chunks", "--chunks")
shutil.copy(SCRATCH / "plain-chunks/000000.torch", SCRATCH / "changed" / chunk)
server.client.upload_file(str(SCRATCH / "changed" / chunk), "lab", f"rooms/{chunk}")
assert exchanged(run(DATA, "there/store", url=proxy.url), DATA)[1] == (SCRATCH / "changed" / chunk).stat().st_size
run("changed", "changed-here")
same_rows("changed-here", "there/store")
assert (SCRATCH / "here/store/trials.parquet").read_bytes() != (SCRATCH / "there/store/trials.parquet").read_bytes()
server.client.upload_file(str(SCRATCH / "chunks" / chunk), "lab", f"rooms/{chunk}")
said("a chunk that changes is read again, and replaces the results of the old one")

# Parts of a run written to the server, merged there and read from there.
for number in [1, 2]:
    run(DATA, f"{STORES}/part-{number}", "--shard", f"{number}/2", url=proxy.url)
run("chunks", "whole", "--shard", "1/1")
atsplat("merge", f"{STORES}/part-1", f"{STORES}/part-2", "--out", f"{STORES}/merged", "--cache", "cache", url=proxy.url)
atsplat("merge", f"{STORES}/part-1", f"{STORES}/part-2", "--out", "merged", "--cache", "cache", url=proxy.url)
for table in TABLES:
    assert server.bytes("lab", f"stores/merged/{table}") == (SCRATCH / "merged" / table).read_bytes()
same_rows("whole", "merged")
names = server.names("lab", "stores/merged/")
assert names == [f"stores/merged/{name}" for name in ["provenance.json", *TABLES]], names
merged = f"{STORES}/merged"
atsplat("drift", "accept", "merged", "--baseline", "baseline.json", "--why", "a try", "--no-probe")
atsplat("drift", merged, "--baseline", "baseline.json", "--no-probe", "--cache", "cache", url=proxy.url)
atsplat("report", merged, "--out", "merged-page", "--cache", "cache", url=proxy.url)
atsplat("report", "merged", "--out", "merged-page-here")
for name in [path.name for path in (SCRATCH / "merged-page-here/tables").glob("*.csv")]:
    assert (SCRATCH / "merged-page/tables" / name).read_bytes() == (SCRATCH / "merged-page-here/tables" / name).read_bytes()
said("stores are written, merged, compared and reported on the server")

# A writer that is killed, one that resumes its store, and two at once.
(SCRATCH / "slow").write_text(f'while read -r trial; do sleep 1.2; printf \'%s\\n\' "$trial"; done | {sys.executable} {NEAREST}')
slow = ["--method", "nearest=exec:sh slow"]
command = ["run", "rooms-2v-128", "--data", DATA, "--cache", "cache", *slow, "--out"]
parts = lambda name: [key for key in server.names("lab", f"stores/{name}/") if "/parts/" in key]


def until(condition):
    for _ in range(600):
        if condition():
            return
        time.sleep(0.1)
    raise AssertionError("nothing happened for a minute")


killed = start(*command, f"{STORES}/killed", url=proxy.url)
until(lambda: parts("killed"))
killed.send_signal(signal.SIGKILL)
killed.communicate()
before = len(parts("killed"))
errors = atsplat(*command, f"{STORES}/killed", url=proxy.url)
assert "did not finish" in errors and not parts("killed"), errors
atsplat("run", "rooms-2v-128", "--data", "chunks", *slow, "--out", "slow-here")
atsplat("drift", "accept", "slow-here", "--baseline", "slow.json", "--why", "a try", "--no-probe")
atsplat("drift", f"{STORES}/killed", "--baseline", "slow.json", "--no-probe", "--cache", "cache", url=proxy.url)
said(f"a run that was killed after {before} of {SCENES} trials is resumed")

first = start(*command, f"{STORES}/two", url=proxy.url)
until(lambda: parts("two"))
second = start(*command, f"{STORES}/two", url=proxy.url)
errors = finish(first, 1)
assert "also written by process" in errors and str(second.pid) in errors, errors
finish(second)
atsplat("drift", f"{STORES}/two", "--baseline", "slow.json", "--no-probe", "--cache", "cache", url=proxy.url)
said("of two writers the earlier one stops, and the results are whole")

# The last, since it ends every other access.
server.check_credentials()
errors = run(DATA, "denied", cache="denied-cache", url=proxy.url, code=1)
assert f"{DATA}: access denied" in errors, errors
said("wrong credentials are an error, and no message shows them")
