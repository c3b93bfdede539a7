"""What docs/clusters.md says of many workers: tables from the constants below, each of which was measured or is marked as assumed."""

from math import ceil

SCORED_PIXEL = 60 / 445 / 3 / 256**2  # s: splatting and scoring on one core, crates/eval/benches/README.md
ENCODING = 0.1  # s a trial: assumed, as published for feed-forward methods on one graphics card
LOADING = 20.0  # s: assumed, from the start of a worker to its first trial, weights of the network among it
FRAME = 22_900 / 256**2 * 640 * 360  # bytes: JPEG, as many per pixel as a real scene's frames of 256 x 256
SCENE = 279 * FRAME  # bytes: all frames of that scene
MERGED_STORE, MERGED_TRIAL = 0.0018, 0.000074  # s: processor time of `merge` of 6474 trials in 16 and in 256 stores, on a memory file system
CHUNK = 1e8  # bytes: assumed, as pixelSplat's converter fills them
STORE, TRIAL_ROW, TARGET_ROW = 27_000, 140, 76  # bytes: a store of one trial, and what each row adds; 32 assumed for a hash that repeats in the rows that were measured

# Protocol: scenes, context views, targets of all scenes, pixels of a target.
PROTOCOLS = {
    "re10k-2v-256": (6474, 2, 19422, 256**2),
    "re10k-overlap": (5601, 2, 16803, 256**2),
    "re10k-extrapolation": (6424, 2, 19272, 256**2),
    "acid-2v-256": (1595, 2, 4785, 256**2),
    "acid-overlap": (1341, 2, 4023, 256**2),
    "re10k-to-dl3dv-256": (140, 2, 7000, 256**2),
    "dl3dv-2v-256x448": (140, 2, 7000, 256 * 448),
    "dl3dv-4v-256x448": (140, 4, 7000, 256 * 448),
    "dl3dv-6v-256x448": (140, 6, 7000, 256 * 448),
    "dl3dv-6v-224": (140, 6, 1120, 224**2),
    "dl3dv-6v-extrapolation": (140, 6, 2800, 256 * 448),
    "dl3dv-12v-512x960": (140, 12, 13734, 512 * 960),
}


def row(names, workers):
    chosen = [PROTOCOLS[name] for name in names]
    # A scene is never divided: the worker with the most scenes of each protocol bounds the time.
    work = [(scenes, ENCODING + targets / scenes * pixels * SCORED_PIXEL) for scenes, _, targets, pixels in chosen]
    seconds = LOADING + sum(ceil(scenes / workers) * each for scenes, each in work)
    merge = workers * MERGED_STORE + sum(scenes for scenes, _ in work) * MERGED_TRIAL
    efficiency = sum(scenes * each for scenes, each in work) / workers / (seconds + merge)
    rows = sum(scenes * TRIAL_ROW + targets * TARGET_ROW for scenes, _, targets, _ in chosen)
    frames = sum(scenes * context + targets for scenes, context, targets, _ in chosen) * FRAME
    # Every chunk once, and by another worker where shards meet within it.
    chunks = sum(scenes * SCENE + (min(workers, scenes) - 1) * CHUNK for scenes, _ in work)
    return efficiency, (
        f"| {workers} | {seconds:.0f} | {merge:.1f} | {efficiency:.0%} | {frames / 1e9:.1f} to {chunks / 1e9:.0f} "
        f"| {(rows + workers * STORE) / 1e6:.0f} | {rows / 1e6:.1f} |"
    )


for title, names in [("RE10K", ["re10k-2v-256"]), ("All published protocols", list(PROTOCOLS))]:
    half = next(workers for workers in range(1, 4096) if row(names, workers)[0] < 0.5)
    print(f"\n{title}: half of the time is lost from {half} workers on.\n")
    print("| workers | run, s | merge, s | efficiency | read, GB | stores, MB | merged, MB |\n|---|---|---|---|---|---|---|")
    for workers in (1, 16, 256, 4096):
        print(row(names, workers)[1])
