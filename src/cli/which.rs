//! The choice of effects: options shared by all commands that composite into recordings.

use anyhow::{Result, bail};

use locard_engine::compositor::Settings;

/// The name of the analysis' registration of the camera, which can be disabled like an effect.
const REGISTRATION: &str = "registration";

#[derive(clap::Args)]
pub struct Which {
    /// Only these effects
    #[arg(long, value_name = "EFFECTS", value_delimiter = ',', conflicts_with = "without")]
    only: Option<Vec<String>>,
    /// All effects except these; registration leaves the camera at its recorded poses, and keeps
    /// the other results of an analysis
    #[arg(long, value_name = "EFFECTS", value_delimiter = ',')]
    without: Option<Vec<String>>,
}

impl Which {
    #[cfg(feature = "window")]
    pub fn is_given(&self) -> bool {
        self.only.is_some() || self.without.is_some()
    }

    /// True if the recorded poses are used.
    pub fn leaves_registration(&self) -> bool {
        self.without.iter().flatten().any(|name| name == REGISTRATION)
    }

    /// Applies the choice. An unknown name is an error that lists the known ones.
    pub fn apply(&self, settings: &mut Settings) -> Result<()> {
        if self.only.iter().chain(&self.without).flatten().any(String::is_empty) {
            let names: Vec<&str> = settings.effects().map(|e| e.table()).collect();
            bail!("--only and --without need names of effects, commas between; there are: {}", names.join(", "));
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
