//! Placement surface and scale without depth: a plane through three picked points, and the scale by
//! two points and their true distance.

use glam::{DVec2, DVec3};

use super::click_context::ClickContext;
use super::picked_ground::paint_points;
use super::picture::PictureOutput;
use super::point_picker::{Click, PointPicker};
use super::project::Project;
use locard_engine::support::plane_through;

/// Purpose of picked points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GroundPurpose {
    Plane,
    Scale,
}

impl GroundPurpose {
    fn points(self) -> usize {
        match self {
            Self::Plane => 3,
            Self::Scale => 2,
        }
    }
}

/// Picks the points of a plane or of a scale.
#[derive(Clone, Debug)]
pub struct GroundPick {
    purpose: GroundPurpose,
    picker: PointPicker,
    points_m: Vec<DVec3>,
}

impl GroundPick {
    pub fn new(purpose: GroundPurpose) -> Self {
        Self { purpose, picker: PointPicker::default(), points_m: Vec::new() }
    }

    /// True if no further point is needed.
    pub fn is_complete(&self) -> bool {
        self.points_m.len() == self.purpose.points()
    }

    /// Handles a click. Returns a message.
    pub fn click(&mut self, context: ClickContext<'_>, at_px: DVec2) -> Result<Option<String>, String> {
        let ClickContext { project, ground, frame, .. } = context;
        let (shot, plane, up) = (project.shot(), ground.plane, project.up());
        let (support, accuracy) = match self.picker.click(plane, shot, up, frame, at_px)? {
            Click::SecondView(text) => return Ok(Some(text)),
            Click::Point { support, accuracy } => (support, accuracy),
        };
        self.points_m.push(support.point_m);
        match (self.purpose, self.points_m.as_slice()) {
            (GroundPurpose::Scale, [a, b]) => ground.scale_points_m = Some([*a, *b]),
            (GroundPurpose::Plane, [a, _, _]) => {
                let eye = shot.recording.pose_at_frame(frame.index).map_err(|e| e.to_string())?.position_in_world_m();
                let towards = shot.recording.up.unwrap_or(eye - *a);
                let plane = plane_through(&self.points_m).map(|fit| fit.plane.facing(towards));
                ground.plane = Some(plane.map_err(|e| e.to_string())?);
                return Ok(Some("Evidence is placed on the plane through the three points.".to_owned()));
            }
            _ => {}
        }
        Ok(accuracy)
    }

    /// Paints the picked points and an instruction.
    pub fn paint(&self, picture: &PictureOutput, project: &Project, frame: usize) {
        paint_points(&self.points_m, picture, project, frame);
        if !self.picker.awaits_second_view() {
            let (number, all) = (self.points_m.len() + 1, self.purpose.points());
            picture.prompt(&match self.purpose {
                GroundPurpose::Plane => format!("Click three points of the surface ({number} of {all})"),
                GroundPurpose::Scale => format!("Click two points whose distance you know ({number} of {all})"),
            });
        }
        self.picker.paint(picture, project.shot(), frame);
    }
}
