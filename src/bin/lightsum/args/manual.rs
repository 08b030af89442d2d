//! Flags of `manual`.

use std::path::PathBuf;

use clap::Subcommand;

/// Texts that `manual` prints or writes.
#[derive(Debug, Subcommand)]
pub enum Manual {
    /// Print the completions of a shell.
    Completions {
        /// The shell.
        #[arg(value_enum)]
        shell: clap_complete::Shell,
    },
    /// Write pages of the manual.
    Man {
        /// The folder.
        #[arg(long, value_name = "DIR")]
        into: PathBuf,
    },
    /// Write reference.md: all flags and keys.
    Reference {
        /// The folder.
        #[arg(long, value_name = "DIR")]
        into: PathBuf,
    },
}
