//! What a package installs next to the binary: completions for shells, and manual pages.

use std::path::PathBuf;

use anyhow::Context as _;
use clap::CommandFactory as _;
use clap_complete::Shell;

use crate::Cli;
use crate::paths::NewFolders;
use crate::print::print_text;

const BINARY: &str = "atsplat";

#[derive(Debug, clap::Args)]
pub(crate) struct CompletionsArgs {
    /// The shell to complete in.
    shell: Shell,
}

#[derive(Debug, clap::Args)]
pub(crate) struct ManArgs {
    /// Folder for one page per command, such as `atsplat-run.1`; without it the main page is printed.
    #[arg(long, short, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Prints the completion script of a shell.
pub(crate) fn completions(args: &CompletionsArgs) -> anyhow::Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), BINARY, &mut script);
    print_text(std::str::from_utf8(&script)?)
}

/// Prints or writes manual pages.
pub(crate) fn man(args: &ManArgs) -> anyhow::Result<()> {
    if let Some(folder) = &args.out {
        let _folders = NewFolders::of(folder)?;
        return clap_mangen::generate_to(Cli::command(), folder)
            .with_context(|| format!("writing manual pages into {}", folder.display()));
    }
    let mut page = Vec::new();
    clap_mangen::Man::new(Cli::command()).render(&mut page)?;
    print_text(std::str::from_utf8(&page)?)
}
