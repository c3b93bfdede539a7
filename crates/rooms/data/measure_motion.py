"""How real RE10K clips move, as data/re10k_motion.json.

Usage: python measure_motion.py FOLDER... > re10k_motion.json
Each folder is searched for RE10K trajectory files: a first line, then rows of timestamp, fx fy cx cy, two
slots, and a 3x4 world-to-camera matrix. Needs numpy.

Per clip: the focal length over image width, speed in scene units a second, turn rate in degrees a second,
straightness (distance between the ends over path length), the angle between travel and optical axis, and
the mean baseline over 45, 90 and 135 frames of 1/30 s (null where the clip is shorter). Speeds are
path length over time, so that files that keep every eighth frame count like whole ones.
"""
import json, pathlib, sys
import numpy as np


def rotation_degrees(a, b):
    return float(np.degrees(np.arccos(np.clip((np.trace(a.T @ b) - 1) / 2, -1, 1))))


def measure(path):
    lines = [line.split() for line in path.read_text().splitlines()[1:] if line.strip()]
    rows = np.array([[float(x) for x in line] for line in lines])
    seconds = (rows[:, 0] - rows[0, 0]) / 1e6
    w2c = rows[:, 7:].reshape(-1, 3, 4)
    rotation, centre = w2c[:, :, :3], np.array([-m[:, :3].T @ m[:, 3] for m in w2c])
    # Positions a quarter of a second apart: closer ones measure the noise of structure from motion.
    times = np.arange(0, seconds[-1] + 1e-9, 0.25)
    at = np.stack([np.interp(times, seconds, centre[:, k]) for k in range(3)], 1)
    arc = np.linalg.norm(np.diff(at, axis=0), axis=1).sum()
    near = [int(np.abs(seconds - t).argmin()) for t in np.arange(0, seconds[-1] + 1e-9, 0.5)]
    turned = sum(rotation_degrees(rotation[a], rotation[b]) for a, b in zip(near, near[1:]))
    chord = centre[-1] - centre[0]
    forward = np.mean([r[2] for r in rotation], 0)
    cosine = chord @ forward / (np.linalg.norm(chord) * np.linalg.norm(forward))

    def baseline(frames):
        span = frames / 30
        starts = np.arange(0, seconds[-1] - span + 1e-9, 0.1)
        if len(starts) == 0:
            return None
        where = lambda t: np.stack([np.interp(t, seconds, centre[:, k]) for k in range(3)], 1)
        return round(float(np.linalg.norm(where(starts + span) - where(starts), axis=1).mean()), 4)

    return {
        "clip": path.stem,
        "frames": len(rows),
        "seconds": round(float(seconds[-1]), 3),
        "fx": round(float(rows[0, 1]), 6),
        "fy": round(float(rows[0, 2]), 6),
        "speed": round(float(arc / times[-1]), 4),
        "turn-degrees-per-second": round(turned / float(seconds[near[-1]]), 3),
        "straightness": round(float(np.linalg.norm(at[-1] - at[0]) / arc), 4),
        "travel-to-axis-degrees": round(float(np.degrees(np.arccos(np.clip(cosine, -1, 1)))), 2),
        "baseline-45": baseline(45),
        "baseline-90": baseline(90),
        "baseline-135": baseline(135),
    }


files = sorted(p for folder in sys.argv[1:] for p in pathlib.Path(folder).rglob("*.txt"))
clips = [measure(p) for p in files if not p.name.startswith("LICENSE")]
print('{"unit": "scene units of structure from motion, whose scale differs from clip to clip",\n "clips": [')
print(",\n".join("  " + json.dumps(clip) for clip in clips))
print("]}")
