"""Puts many mutants into one source file, each behind a switch that is read when the program runs.

The body `{ a + b }` of a function becomes

    { if crate::mutant_switch::on(3) { a - b } else if crate::mutant_switch::on(4) { a * b } else { a + b } }
"""

import re

MODULE = """
#[doc(hidden)]
pub mod mutant_switch {
    static CHOSEN: std::sync::LazyLock<usize> =
        std::sync::LazyLock::new(|| std::env::var("ATSPLAT_MUTANT").map_or(0, |id| id.parse().unwrap()));
    #[inline]
    pub fn on(id: usize) -> bool {
        *CHOSEN == id
    }
}
"""


def offsets(text, span):
    """Where a span of cargo-mutants (lines and columns from 1) begins and ends."""
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    return [starts[place["line"] - 1] + place["column"] - 1 for place in (span["start"], span["end"])]


def mutated(text, mutant):
    start, end = offsets(text, mutant["span"])
    return text[:start] + mutant["replacement"] + text[end:]


def function(text, mutant):
    """Where the function of a mutant starts, where its body starts and ends (within the braces), and its signature."""
    start, end = offsets(text, mutant["function"]["span"])
    bare = re.sub(r"^\s*(//|#\[).*$", lambda found: " " * len(found[0]), text[start:end], flags=re.M)
    depth = 0
    for at in range(re.search(r"\bfn\s", bare).start(), len(bare)):
        depth += (bare[at] in "([") - (bare[at] in ")]")
        if bare[at] == "{" and depth == 0:
            return start, start + at + 1, end - 1, bare[:at]
    raise ValueError(f"no body: {mutant['name']}")


def constant(text, mutant):
    """Where the signature says `const`, if it does."""
    start, _, _, signature = function(text, mutant)
    found = re.search(r"\bconst(?=\s+fn\b)", signature)
    return found and (start + found.start(), start + found.end())


def switchable(text, mutant):
    """Changes outside of functions have no switch, nor do opaque return types: two bodies have two types."""
    return mutant["function"] is not None and not re.search(r"->[^{]*\bimpl\b", function(text, mutant)[3])


def with_switches(text, mutants):
    """The file with all mutants; their functions are no longer constant."""
    bodies = {}
    for mutant in mutants:
        _, start, end, _ = function(text, mutant)
        bodies.setdefault((start, end), []).append(mutant)
        if found := constant(text, mutant):
            text = text[: found[0]] + " " * (found[1] - found[0]) + text[found[1] :]

    def part(start, end, parent=None):
        out, at = "", start
        for body in sorted(bodies, key=lambda body: (body[0], -body[1])):
            if body == parent or body[0] < at or body[1] > end:
                continue
            out += text[at : body[0]]
            for mutant in bodies[body]:
                a, b = offsets(text, mutant["span"])
                changed = text[body[0] : a] + mutant["replacement"] + text[b : body[1]]
                out += f"\nif crate::mutant_switch::on({mutant['id']}) {{ // mutant {mutant['id']}\n{changed}\n}} else "
            out += "{ // mutant 0\n" + part(*body, body) + "}"
            at = body[1]
        return out + text[at:end]

    return part(0, len(text))


def mutant_at(text, line):
    """The mutant on a line of a file with switches; 0 outside of mutants."""
    for before in reversed(text.splitlines()[:line]):
        if found := re.search(r"// mutant (\d+)$", before):
            return int(found[1])
    return 0
