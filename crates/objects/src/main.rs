//! `atsplat-objects URL`: reads and writes object storage for atsplat, which starts it when it is given a URL. The only part of
//! the toolkit that opens network connections: those to this URL.

use std::io::{Write as _, stderr, stdin, stdout};
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let outcome =
        match arguments.as_slice() {
            [url] if !url.starts_with('-') => {
                atsplat_objects::serve::serve(url, stdin().lock(), stdout()).map_err(|error| error.to_string())
            }
            _ => Err("expected one URL: atsplat starts this program when it is given one, such as s3://bucket/data"
                .to_owned()),
        };
    let Err(error) = outcome else { return ExitCode::SUCCESS };
    writeln!(stderr(), "atsplat-objects: {error}").ok();
    ExitCode::FAILURE
}
