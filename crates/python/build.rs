//! Passes the commit, as the binary's build does.

include!("../cli/build.rs");
