//! The files of a job.

use super::error::FarmError;
use super::template::FarmJob;
use super::template_text;

impl FarmJob {
    /// The files of the job: name, content.
    pub fn files(&self) -> Result<Vec<(&'static str, String)>, FarmError> {
        self.check()?;
        Ok(vec![
            ("template.yaml", template_text::template(self)),
            ("parameter_values.yaml", template_text::bundle_values(self)),
            ("parameters.yaml", template_text::openjd_values(self)),
            ("slurm.sh", self.slurm()),
            ("parts.txt", self.ranges().iter().map(|range| format!("{range}\n")).collect()),
            ("README.txt", self.readme()),
        ])
    }
}
