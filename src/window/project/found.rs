//! What was found of the footage while a person works.

use std::path::PathBuf;

use super::{Edit, Project, value};
use crate::analyse::Analysis;
use crate::shot::{Follows, ShotError};

impl Project {
    /// Goes on with an analysis of the recording. The scene, the past and what is set stay. What follows the analysis does so in
    /// every step, where it is as it was opened: that is no person's doing, and nothing to be saved.
    pub fn take_analysis(&mut self, folder: PathBuf, analysis: Analysis) -> Result<(), ShotError> {
        let follows = self.shot.take_analysis(folder, analysis)?;
        let opened = self.opened.clone();
        let follow = |edit: &mut Edit| {
            for Follows { table, name, value: found } in &follows {
                if value(edit, table, name) == value(&opened, table, name) {
                    // Within the range: it was found there.
                    let _ = edit.rig.set(&mut edit.settings, table, name, found);
                }
                let Some(other) = &mut edit.other else { continue };
                let of_other = Edit { rig: other.rig.clone(), settings: other.settings.clone(), ..opened.clone() };
                if value(&of_other, table, name) == value(&opened, table, name) {
                    let _ = other.rig.set(&mut other.settings, table, name, found);
                }
            }
        };
        self.history.each(follow);
        [&mut self.opened, &mut self.saved].into_iter().for_each(follow);
        // What stands wrong, and what is compared with, are others by other poses.
        self.scene_version += 1;
        self.other_version = self.version + 1;
        self.follow();
        Ok(())
    }
}
