//! `atsplat train` from the outside.

mod common;
