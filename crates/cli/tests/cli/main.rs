//! The binary, as its users call it. One program, because each one links the whole workspace.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod arguments;
mod budget;
mod commit;
mod common;
mod crash;
mod data;
mod device;
mod drift;
mod environment;
mod evaluation;
mod exec;
mod findings;
mod findings_left_out;
mod fit;
mod fit_output;
mod fit_photos;
mod fit_resumed;
mod index_fit;
mod log;
mod lost_objects;
mod overwritten_inputs;
mod protocol;
mod protocol_data;
mod reconstruct;
mod reconstruct_photos;
mod rejections;
mod render;
mod render_input;
mod render_scene;
mod rows;
mod run;
mod shards;
mod shell;
mod simulate;
mod stress;
mod tradeoff;
mod train;
mod weights;
