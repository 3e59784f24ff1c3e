//! Which effects may run: options shared by everything that draws into recordings.

use anyhow::{Result, bail};

use locard_engine::compositor::Settings;

/// Told as an effect is, although it is a part of the analysis: where the camera was.
const REGISTRATION: &str = "registration";

#[derive(clap::Args)]
pub struct Which {
    /// Only these effects
    #[arg(long, value_name = "EFFECTS", value_delimiter = ',', conflicts_with = "without")]
    only: Option<Vec<String>>,
    /// All effects but these; registration leaves the camera where the recording says it was, and keeps what else an analysis found
    #[arg(long, value_name = "EFFECTS", value_delimiter = ',')]
    without: Option<Vec<String>>,
}

impl Which {
    #[cfg(feature = "window")]
    pub fn is_asked(&self) -> bool {
        self.only.is_some() || self.without.is_some()
    }

    /// Whether the poses are the recorded ones.
    pub fn leaves_registration(&self) -> bool {
        self.without.iter().flatten().any(|name| name == REGISTRATION)
    }

    /// Fails on a name that no effect has, and lists the known ones.
    pub fn apply(&self, settings: &mut Settings) -> Result<()> {
        if self.only.iter().chain(&self.without).flatten().any(String::is_empty) {
            let known: Vec<&str> = settings.effects().map(|e| e.table()).collect();
            bail!("--only and --without need names of effects, commas between; there are: {}", known.join(", "));
        }
        if let Some(names) = &self.only {
            settings.only(names)?;
        }
        if let Some(names) = &self.without {
            let effects: Vec<String> = names.iter().filter(|name| *name != REGISTRATION).cloned().collect();
            settings.without(&effects)?;
        }
        Ok(())
    }
}
