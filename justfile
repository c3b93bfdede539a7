# `just RECIPE`; `just --list` shows what there is. CI runs the same stages (.ci/run).

# What a change must pass before review: formatting and lints.
check:
    cargo fmt --all --check
    cargo clippy --release --workspace --all-targets --locked -- -D warnings

# Unit tests of every crate, the command line's too.
test-fast:
    cargo test --release --workspace --locked --lib --bins

# Every test.
test:
    cargo test --release --workspace --locked

# One file or folder of a crate's `tests/`, or the tests in it whose names contain a text, e.g. `just test-file eval rows::`.
test-file name *texts:
    cargo test --release --workspace --locked --test {{name}} -- {{texts}}

# All of CI, or single stages, e.g. `just ci lints documentation`.
ci *stages:
    .ci/run {{stages}}

# Accept what changed on purpose: simulated trials of the tests, snapshots, then the baseline and the reference report.
bless why:
    cargo test --release --workspace --locked --test eval -- device_trials:: || \
        ATSPLAT_BLESS=1 cargo test --release --workspace --locked --test eval -- device_trials::
    INSTA_UPDATE=always cargo test --release --workspace --locked
    reports/regenerate "{{why}}"

# Criterion benchmarks of a crate.
bench crate:
    cargo bench -p atsplat-{{crate}}

# Whether a crate's tests notice small changes to it; can be stopped and continued.
mutants crate:
    tests/mutants/run {{crate}}

# One fuzz target of fuzz/Cargo.toml.
fuzz target:
    cargo +nightly fuzz run {{target}}
