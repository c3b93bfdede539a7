"""What Python adds to the binary on 100 trials of ready images: ratios of processor time, in interleaved pairs.

python overhead.py BINARY [PAIRS], in an environment with atsplat and Pillow. The images are the same: the binary reads them as PNG files
(`renders:DIR`), Python in a method that has them as arrays, or with `png` as the third argument opens the same files with Pillow, which
then decodes 300 images itself. The interpreter's start is part of its time.
"""

import json
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

PROTOCOL, SCENES, ENTRIES, FRAMES = "re10k-2v-256", 4, 25, 40

METHOD = """
import sys
import numpy as np
import atsplat

rooms, index, stored, out, kind = sys.argv[1:]
arrays = kind == "arrays"

def ready(images, context, target, *, trial):
    folder = f"{stored}/{trial.scene}-{trial.entry}"
    if arrays:
        return np.load(folder + ".npy")
    from PIL import Image
    return np.stack([np.asarray(Image.open(f"{folder}/{frame:06}.png")) for frame in target.frames])

assert not atsplat.evaluate(ready, PROTOCOL, data=rooms, index=index, out=out).failures()
""".replace("PROTOCOL", repr(PROTOCOL))


def seconds(*command):
    """User and system time of a process."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([str(part) for part in command], check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main(binary, pairs="5", kind="arrays"):
    pairs = int(pairs)
    with tempfile.TemporaryDirectory() as folder:
        rooms, index, warped = (Path(folder) / name for name in ("rooms", "index.json", "warped"))
        seconds(binary, "data", "simulate", rooms, "--scenes", SCENES, "--frames", FRAMES, "--samples", 1)
        scenes = [f"rooms-test-{scene:08}" for scene in range(SCENES)]
        entries = [{"context": [at % 15, 25 + at % 15], "target": [at % 15 + 3, 18, 21 + at % 3]} for at in range(ENTRIES)]
        index.write_text(json.dumps(dict.fromkeys(scenes, entries)))
        common = (PROTOCOL, "--data", rooms / "test", "--index", index)
        seconds(binary, "run", *common, "--method", "warp", "--keep-images", "all", "--out", warped)
        images = warped / "images" / PROTOCOL / "warp"
        for trial in list(images.iterdir()):
            ready = [np.asarray(Image.open(file)) for file in sorted(trial.glob("*.png"))]
            np.save(trial.with_name(trial.name + ".npy"), np.stack(ready))
        ratios = []
        for pair in range(pairs):
            out = Path(folder) / f"pair-{pair}"
            theirs = seconds(binary, "score", *common, "--renders", images, "--out", out / "binary")
            ours = seconds(sys.executable, "-c", METHOD, rooms / "test", index, images, out / "python", kind)
            ratios.append(ours / theirs)
            print(f"binary {theirs:.2f} s, Python {ours:.2f} s, ratio {ours / theirs:.3f}", flush=True)
        print(f"median ratio of {pairs} pairs on {SCENES * ENTRIES} trials: {statistics.median(ratios):.3f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
