//! Passes the commit, as the binary's build does.

#[path = "../cli/build.rs"]
mod commit;

fn main() {
    commit::main();
}
