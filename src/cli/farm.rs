//! `locard farm`.

mod machine;
mod part;
mod plan;

use anyhow::Result;

#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    task: FarmTask,
}

#[derive(clap::Subcommand)]
enum FarmTask {
    /// Write a folder of files that composite a recording in parts, on many machines
    Template(plan::TemplateArgs),
    /// Composite one part, unless it is there and complete; called by the templates' tasks
    Part(part::PartArgs),
    /// Check that this machine fits a plan; called by the templates' tasks
    Check(machine::MachineArgs),
}

pub fn run(args: &Args) -> Result<()> {
    match &args.task {
        FarmTask::Template(args) => plan::run(args),
        FarmTask::Part(args) => part::run(args),
        FarmTask::Check(args) => {
            args.check_build()?;
            args.check_adapter()
        }
    }
}
