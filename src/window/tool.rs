//! The active tool. Clicks, drags and Esc in the picture go to it, and to nothing else.

use eframe::egui::{Button, CursorIcon, Ui};
use glam::DVec2;

use super::click_context::ClickContext;
use super::ground_pick::GroundPick;
use super::handles::ActiveTransform;
use super::lamp_pick::LampPick;
use super::picture::PictureOutput;
use super::placement::Placement;
use super::project::Project;
use super::region_picker::{RegionPick, RegionPrompt, RegionPurpose};
use super::scan_pick::ScanPick;
use locard_engine::pixels::Rect;

/// A tool, with its state.
#[derive(Debug, Default)]
pub enum Tool {
    /// Selects items. Their handles, and keys, begin a transform.
    #[default]
    Select,
    /// Moves, turns or scales the selected item.
    Transform(Box<ActiveTransform>),
    /// Places a model.
    Place(Box<Placement>),
    /// Picks the points of a plane or of a scale.
    PickGround(GroundPick),
    /// Picks the position of a lamp, or a white surface.
    PickLamp(LampPick),
    /// Picks positions of points that a scan shows.
    PickScan(ScanPick),
    /// Picks rectangles of the picture.
    PickRegion(RegionPick),
}

impl Tool {
    /// True if a click picks a point of the world, which takes a camera pose.
    pub fn picks_point(&self) -> bool {
        matches!(self, Self::Place(_) | Self::PickGround(_) | Self::PickLamp(_) | Self::PickScan(_))
    }

    /// True if clicks in the picture are its input.
    pub fn captures_clicks(&self) -> bool {
        self.picks_point() || matches!(self, Self::PickRegion(_))
    }

    /// True if drags in the picture are its input.
    pub fn captures_drags(&self) -> bool {
        matches!(self, Self::Transform(_) | Self::Place(_) | Self::PickRegion(_))
    }
}

/// The active tool, and the tools that it interrupts.
#[derive(Debug, Default)]
pub struct ToolStack {
    active: Tool,
    /// The last one resumes when the active tool ends.
    interrupted: Vec<Tool>,
    /// The last picked region, until it is taken.
    picked_region: Option<(RegionPurpose, Option<Rect>)>,
}

impl ToolStack {
    pub fn active(&self) -> &Tool {
        &self.active
    }

    pub fn active_mut(&mut self) -> &mut Tool {
        &mut self.active
    }

    /// Replaces all tools. A transform is completed before.
    pub fn begin(&mut self, tool: Tool) {
        self.interrupted.clear();
        self.interrupt(tool);
        if !matches!(self.active, Tool::Transform(_)) {
            self.interrupted.clear();
        }
    }

    /// Activates a tool until it ends, then resumes the present one. A transform is completed
    /// before.
    fn interrupt(&mut self, tool: Tool) {
        let waiting = match self.active {
            Tool::Transform(_) => tool,
            _ => std::mem::replace(&mut self.active, tool),
        };
        if !matches!(waiting, Tool::Select) {
            self.interrupted.push(waiting);
        }
    }

    /// Ends the active tool.
    fn finish(&mut self) -> Tool {
        std::mem::replace(&mut self.active, self.interrupted.pop().unwrap_or_default())
    }

    /// Ends all tools except a transform, which ends in [`Self::update_transform`] with its
    /// uncommitted change. Returns false if no tool was active.
    pub fn cancel(&mut self) -> bool {
        self.interrupted.clear();
        self.transform().is_some() || !matches!(self.finish(), Tool::Select)
    }

    /// Begins, changes or ends a transform.
    pub fn update_transform<T>(&mut self, update: impl FnOnce(&mut Option<Box<ActiveTransform>>) -> T) -> T {
        let mut transform = self.take_transform();
        let result = update(&mut transform);
        transform.into_iter().for_each(|transform| self.interrupt(Tool::Transform(transform)));
        result
    }

    fn take_transform(&mut self) -> Option<Box<ActiveTransform>> {
        self.transform()?;
        match self.finish() {
            Tool::Transform(active) => Some(active),
            _ => None,
        }
    }

    /// The transform in progress.
    pub fn transform(&self) -> Option<&ActiveTransform> {
        match &self.active {
            Tool::Transform(active) => Some(active),
            _ => None,
        }
    }

    /// The placement of a model, active or interrupted.
    pub fn placement(&self) -> Option<&Placement> {
        self.interrupted.iter().chain([&self.active]).find_map(|tool| match tool {
            Tool::Place(placement) => Some(&**placement),
            _ => None,
        })
    }

    /// The placement of a model, active or interrupted.
    pub fn placement_mut(&mut self) -> Option<&mut Placement> {
        self.interrupted.iter_mut().chain([&mut self.active]).find_map(|tool| match tool {
            Tool::Place(placement) => Some(&mut **placement),
            _ => None,
        })
    }

    /// Begins to pick points. A model that is being placed is placed afterwards, on the new
    /// surface.
    pub fn pick_ground(&mut self, pick: GroundPick) {
        self.interrupted.retain(|tool| matches!(tool, Tool::Place(_)));
        if !matches!(self.active, Tool::Place(_) | Tool::Transform(_)) {
            self.active = Tool::Select;
        }
        if let Some(placement) = self.placement_mut() {
            placement.forget_first_view();
        }
        self.interrupt(Tool::PickGround(pick));
    }

    /// Begins or ends to pick a point for the light.
    pub fn toggle_lamp_pick(&mut self, pick: LampPick) {
        if self.lamp_pick() == Some(pick) {
            self.finish();
        } else {
            self.begin(Tool::PickLamp(pick));
        }
    }

    pub fn lamp_pick(&self) -> Option<LampPick> {
        match self.active {
            Tool::PickLamp(pick) => Some(pick),
            _ => None,
        }
    }

    pub fn scan_pick(&self) -> Option<&ScanPick> {
        match &self.active {
            Tool::PickScan(pick) => Some(pick),
            _ => None,
        }
    }

    pub fn scan_pick_mut(&mut self) -> Option<&mut ScanPick> {
        match &mut self.active {
            Tool::PickScan(pick) => Some(pick),
            _ => None,
        }
    }

    /// The purpose of the regions that are being picked.
    pub fn region_purpose(&self) -> Option<RegionPurpose> {
        match &self.active {
            Tool::PickRegion(pick) => Some(pick.purpose()),
            _ => None,
        }
    }

    /// Begins or ends to pick regions.
    pub fn toggle_region_pick(&mut self, pick: RegionPick) {
        self.picked_region = None;
        match &mut self.active {
            Tool::PickRegion(active) if active.purpose() == pick.purpose() => _ = self.finish(),
            Tool::PickRegion(active) => *active = pick,
            _ => self.interrupt(Tool::PickRegion(pick)),
        }
    }

    /// Shows a button that begins to pick regions. It is highlighted meanwhile; pressing it again
    /// cancels.
    pub fn region_button(&mut self, ui: &mut Ui, text: &str, prompt: RegionPrompt) {
        let is_active = self.region_purpose() == Some(prompt.purpose);
        if ui.add(Button::selectable(is_active, text).frame_when_inactive(true)).clicked() {
            self.toggle_region_pick(RegionPick::new(prompt));
        }
    }

    /// Ends picking of regions.
    pub fn cancel_region_pick(&mut self) {
        if matches!(self.active, Tool::PickRegion(_)) {
            self.finish();
        }
    }

    /// Takes the last picked region; `None` also if it is empty.
    pub fn take_region(&mut self, purpose: RegionPurpose) -> Option<Rect> {
        self.picked_region.take_if(|(of, _)| *of == purpose)?.1
    }

    /// Handles drags in the picture that pick a region, and paints it.
    pub fn update_region(&mut self, output: &PictureOutput) {
        let Tool::PickRegion(pick) = &mut self.active else { return };
        if let Some(region) = pick.update(output) {
            self.picked_region = Some((pick.purpose(), region));
        }
        if pick.is_done() {
            self.finish();
        }
    }

    /// Handles a click that picks a point of the world. Returns a message.
    pub fn click(&mut self, context: ClickContext<'_>, at_px: DVec2) -> Result<Option<String>, String> {
        match &mut self.active {
            Tool::Place(placement) => placement.click(context, at_px),
            Tool::PickGround(pick) => {
                let message = pick.click(context, at_px);
                if pick.is_complete() {
                    self.finish();
                }
                message
            }
            Tool::PickLamp(pick) => {
                let pick = *pick;
                let message = pick.click(context, at_px);
                if message.is_ok() || pick == LampPick::Position {
                    self.finish();
                }
                message
            }
            Tool::PickScan(pick) => pick.click(context.project.shot(), context.frame, at_px),
            Tool::Select | Tool::Transform(_) | Tool::PickRegion(_) => Ok(None),
        }
    }

    /// Paints the marks and the instruction of a tool that picks a point of the world.
    pub fn paint(&self, output: &PictureOutput, project: &Project, frame: usize) {
        match &self.active {
            Tool::PickGround(pick) => pick.paint(output, project, frame),
            Tool::Place(placement) => placement.paint_first_view(output, project, frame),
            Tool::PickLamp(pick) => output.prompt(pick.prompt()),
            Tool::PickScan(pick) => output.prompt(pick.prompt()),
            Tool::Select | Tool::Transform(_) | Tool::PickRegion(_) => {}
        }
        let is_aiming = matches!(self.active, Tool::Place(_) | Tool::PickLamp(_) | Tool::PickScan(_));
        if output.pointed.is_some() && is_aiming {
            output.response.ctx.set_cursor_icon(CursorIcon::Crosshair);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn region(purpose: RegionPurpose) -> RegionPick {
        RegionPick::new(RegionPrompt { purpose, hint: "", min_side_px: 1, repeats: false })
    }

    #[test]
    fn interrupted_tool_resumes_and_cancel_ends_all() {
        let mut tools = ToolStack::default();
        assert!(!tools.cancel());
        tools.begin(Tool::PickLamp(LampPick::White));
        tools.toggle_region_pick(region(RegionPurpose::Edge));
        tools.toggle_region_pick(region(RegionPurpose::Patch));
        assert_eq!((tools.region_purpose(), tools.lamp_pick()), (Some(RegionPurpose::Patch), None));
        tools.toggle_region_pick(region(RegionPurpose::Patch));
        assert_eq!((tools.region_purpose(), tools.lamp_pick()), (None, Some(LampPick::White)));
        tools.toggle_region_pick(region(RegionPurpose::Edge));
        assert!(tools.cancel() && matches!(tools.active(), Tool::Select));
        assert!(!tools.cancel());
    }
}
