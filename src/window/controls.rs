//! A control for every parameter, generated from its declaration.

use eframe::egui::containers::menu::MenuButton;
use eframe::egui::{self, Color32, RichText, Ui};

use super::Project;
use super::fields::{has_just_opened, rounded, short, typed_parser};
use super::parameter_help::{displayed, help, suffix};
use super::project::{Origin, tables};
use super::row_widths::{RowWidths, STOPS, VALUE};
use super::slider::{self, SliderScale, rounded_value};
use locard_engine::camera::stops::{self, Step, Stop};
use locard_engine::compositor::ON;
use locard_engine::params::{Kind, Spec, Value, title};
use locard_engine::shot::Note;
use locard_engine::text::without_options;

/// Filters of the parameter list.
#[derive(Clone, Debug, Default)]
pub struct Controls {
    search: String,
    /// Shows only parameters that the user changed.
    changed_only: bool,
}

/// Result of a control.
#[derive(Clone, Debug)]
struct ValueChange {
    to: Option<Value>,
    /// Removes the value from the scene's own settings.
    resets: bool,
    /// The drag or the text entry has ended: the next change is an undo step of its own.
    is_done: bool,
}

impl ValueChange {
    /// A complete change.
    fn set(value: Value) -> Self {
        Self { to: Some(value), resets: false, is_done: true }
    }

    /// A complete change that also removes the value from the scene's own settings.
    fn reset(value: Value) -> Self {
        Self { resets: true, ..Self::set(value) }
    }
}

impl Controls {
    /// Shows all controls and applies changes to the project. `active_effects`: effects that
    /// changed the displayed picture, if known. Returns the error of a rejected value.
    pub fn show(
        &mut self,
        ui: &mut Ui,
        project: &mut Project,
        active_effects: Option<&[&'static str]>,
    ) -> Option<String> {
        ui.horizontal(|ui| {
            let search =
                egui::TextEdit::singleline(&mut self.search).hint_text("Search parameters").desired_width(160.0);
            let response = ui.add(search);
            response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::TextInput, true, "Search parameters"));
            ui.toggle_value(&mut self.changed_only, "Changed").on_hover_text("Only changed settings");
        });
        ui.separator();
        let mut refused = None;
        egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
            let mut is_empty = true;
            for (table, summary) in groups(project) {
                let is_inactive = summary.is_some() && active_effects.is_some_and(|effects| !effects.contains(&table));
                let Some(group) = self.group(ui, project, table, summary, is_inactive) else { continue };
                (is_empty, refused) = (false, group.or(refused.take()));
            }
            if is_empty {
                ui.weak(match self.search.trim() {
                    "" => "No setting is changed.".to_owned(),
                    words => format!("No setting is called “{words}”."),
                });
            }
        });
        refused
    }

    /// Controls of a table, if any match the filters. Returns the error of a rejected value.
    fn group(
        &self,
        ui: &mut Ui,
        project: &mut Project,
        table: &'static str,
        summary: Option<&'static str>,
        is_inactive: bool,
    ) -> Option<Option<String>> {
        let title = title(table);
        let specs: Vec<(Spec, Value, Origin, Option<String>)> = {
            let edit = project.edit();
            let all = tables(&edit.rig, &edit.settings);
            let params = all.into_iter().find(|params| params.table() == table)?;
            let is_visible = |spec: &Spec| {
                let text = format!("{table}.{} {title} {} {}", spec.name, spec.words(), spec.help).to_lowercase();
                self.search.to_lowercase().split_whitespace().all(|word| text.contains(word))
            };
            let with_value = |spec: Spec| {
                let (value, origin) = (params.get(spec.name)?, project.origin(table, spec.name));
                let inactive = spec.idle(params);
                Some((spec, value, origin, inactive))
            };
            let all = params.specs().into_iter().filter(is_visible).filter_map(with_value);
            all.filter(|(_, _, origin, _)| !self.changed_only || *origin == Origin::User).collect()
        };
        if specs.is_empty() {
            return None;
        }
        let mut refused = None;
        let is_filtered = !self.search.is_empty() || self.changed_only;
        let id = ui.make_persistent_id(("group", table, is_filtered));
        let is_effect = summary.is_some();
        let mut state = egui::collapsing_header::CollapsingState::load_with_default_open(ui.ctx(), id, is_effect);
        if is_filtered {
            state.set_open(true);
        }
        let mut is_clicked = false;
        state
            .show_header(ui, |ui| {
                if is_effect {
                    let mut on = project.edit().settings.is_on(table);
                    let switch = ui.checkbox(&mut on, RichText::new(&title).strong());
                    if switch.changed() {
                        project.switch(table, on);
                    }
                    if project.is_pinned(table, ON) {
                        switch.context_menu(|ui| {
                            if ui.button("From the profile").clicked() {
                                refused = project.reset_switch(table).err().map(|error| error.to_string());
                                ui.close();
                            }
                        });
                    }
                    if on && is_inactive {
                        let why = project.edit().settings.effects().find(|effect| effect.table() == table);
                        let why = why.map_or("", |effect| effect.neutral_hint());
                        ui.label(RichText::new("inactive").weak().small()).on_hover_text(format!(
                            "It has no effect on this picture: {why}. Without an object in view, no effect does \
                             anything."
                        ));
                    }
                } else {
                    let heading = egui::Label::new(RichText::new(&title).strong()).sense(egui::Sense::click());
                    is_clicked = ui.add(heading).clicked();
                }
            })
            .body(|ui| {
                if let Some(summary) = summary {
                    ui.label(RichText::new(summary).weak().small());
                }
                let unknown = project.shot().unknown_exposure().filter(|_| table == BLURS);
                if let Some(note) = unknown {
                    unknown_exposure(ui, &note);
                }
                for (spec, value, origin, inactive) in specs {
                    let opened = project.baseline_value(table, spec.name);
                    let is_pinned = origin != Origin::User && project.is_pinned(table, spec.name);
                    let origin = if is_pinned { Origin::Scene } else { origin };
                    let change = control(ui, table, &spec, &value, origin, inactive.as_deref(), opened);
                    let Some(ValueChange { to, resets, is_done }) = change else { continue };
                    if let Some(value) = to {
                        let done = if resets {
                            project.reset(table, spec.name, &value)
                        } else {
                            project.set(table, spec.name, &value)
                        };
                        refused = done.err().map(|error| error.to_string());
                    }
                    if is_done {
                        project.close_step();
                    }
                }
            });
        if is_clicked && let Some(mut state) = egui::collapsing_header::CollapsingState::load(ui.ctx(), id) {
            state.toggle(ui);
            state.store(ui.ctx());
        }
        Some(refused)
    }
}

/// The table whose effect depends on the exposure time most.
const BLURS: &str = "motion_blur";

/// Shows that the exposure time is assumed, and the parameter that sets it.
pub fn unknown_exposure(ui: &mut Ui, note: &Note) {
    let text = match note {
        Note::UnknownExposure { has_times: true } => {
            "Exposure time unknown; half the frame interval is assumed, at most 1/60 s. Set Camera: exposure, Time."
                .to_owned()
        }
        Note::UnknownExposure { has_times: false } => {
            "The pictures have no timestamps, so nothing is blurred by motion. Set Camera: exposure, Time.".to_owned()
        }
        other => without_options(&other.to_string()),
    };
    ui.label(RichText::new(text).small().color(ui.visuals().warn_fg_color));
}

/// All tables in the order of the light path; those of effects with their summary.
fn groups(project: &Project) -> Vec<(&'static str, Option<&'static str>)> {
    let edit = project.edit();
    let summary = |table: &str| edit.settings.effects().find(|effect| effect.table() == table).map(|e| e.summary());
    tables(&edit.rig, &edit.settings).into_iter().map(|params| (params.table(), summary(params.table()))).collect()
}

/// Width of a button with a text.
fn button_width(ui: &Ui, text: &str) -> f32 {
    let font = egui::TextStyle::Button.resolve(ui.style());
    let text = ui.painter().layout_no_wrap(text.to_owned(), font, Color32::WHITE);
    text.size().x.ceil() + 2.0 * ui.spacing().button_padding.x
}

/// One parameter.
fn control(
    ui: &mut Ui,
    table: &str,
    spec: &Spec,
    value: &Value,
    origin: Origin,
    inactive: Option<&str>,
    opened: Option<Value>,
) -> Option<ValueChange> {
    let full = format!("{table}.{}", spec.name);
    let called = format!("{}: {}", title(table), spec.words());
    let reset = opened.clone().unwrap_or_else(|| spec.default.clone());
    let mut change = None;
    ui.horizontal(|ui| {
        origin_marker(ui, origin);
        let text = RichText::new(spec.words());
        let text = if origin == Origin::User { text.strong() } else { text };
        let text = if inactive.is_some() { text.weak() } else { text };
        let left = egui::Layout::left_to_right(egui::Align::Center);
        let beside = ui.spacing().item_spacing.x;
        let dial = dial(&full);
        let (value_width, stops_width) = match value {
            Value::Number(n) => {
                let stops = dial.as_ref().map(|dial| button_width(ui, &dial.text(*n)));
                (button_width(ui, &format!("{}{}", short(*n), suffix(spec, *n))), stops)
            }
            _ => (VALUE, dial.as_ref().map(|_| STOPS)),
        };
        let widths = RowWidths::of(ui.available_width(), beside, spec.optional, value_width, stops_width);
        let name_width = match value {
            // A check box leaves more room.
            Value::Bool(_) => {
                let word = if inactive.is_some() { button_width(ui, "inactive") } else { 0.0 };
                let longest = ui.available_width() - STOPS;
                widths.name.max((button_width(ui, &spec.words()) + word).min(longest))
            }
            _ => widths.name,
        };
        let label = ui.allocate_ui_with_layout(egui::vec2(name_width, 18.0), left, |ui| {
            ui.set_min_width(name_width);
            if inactive.is_none() {
                return ui.add(egui::Label::new(text).truncate().sense(egui::Sense::click()));
            }
            // The word stays visible if the name is truncated.
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                let word = ui.label(RichText::new("inactive").weak().small());
                word.on_hover_ui(|ui| help(ui, &called, &full, spec, inactive, opened.as_ref()));
                ui.with_layout(left, |ui| ui.add(egui::Label::new(text).truncate().sense(egui::Sense::click()))).inner
            })
            .inner
        });
        let label = label.inner;
        let label = label.on_hover_ui(|ui| help(ui, &called, &full, spec, inactive, opened.as_ref()));
        if label.double_clicked() {
            change = Some(ValueChange::reset(reset.clone()));
        }
        label.context_menu(|ui| {
            if reset != spec.default && ui.button(format!("Profile: {}", displayed(&reset))).clicked() {
                change = Some(ValueChange::reset(reset.clone()));
                ui.close();
            }
            if ui.button(format!("Default: {}", displayed(&spec.default))).clicked() {
                change = Some(ValueChange::reset(spec.default.clone()));
                ui.close();
            }
        });
        let mut shown = value.clone();
        if spec.optional {
            let mut has_value = *value != Value::None;
            let given_box = ui.checkbox(&mut has_value, "");
            given_box.widget_info(|| {
                egui::WidgetInfo::selected(egui::Role::CheckBox, true, has_value, format!("{called} is given"))
            });
            if given_box.changed() {
                change = Some(ValueChange::set(if has_value { first_value(&full, &spec.kind) } else { Value::None }));
            }
            if !has_value {
                ui.weak("not given");
                return;
            }
        }
        ui.spacing_mut().slider_width = widths.slider.unwrap_or_default();
        ui.spacing_mut().interact_size.x = VALUE;
        if let Some(done) = field(ui, &called, spec, &mut shown, &reset, widths.slider.is_some()) {
            change = Some(done);
        }
        if let (Some(dial), Value::Number(now)) = (dial, value)
            && let Some(stop) = dial.show(ui, &called, *now, widths.stops)
        {
            change = Some(ValueChange::set(Value::Number(stop)));
        }
    });
    change
}

/// A camera's dial, in thirds of a stop.
struct Dial {
    stops: Vec<Stop>,
    format: fn(f64) -> String,
}

/// The dial of a parameter, if cameras have one for it.
fn dial(full: &str) -> Option<Dial> {
    let (stops, format): (Vec<Stop>, fn(f64) -> String) = match full {
        "camera.lens.f_number" => (stops::f_numbers(Step::Third), stops::format_f_number),
        "camera.exposure.time_s" => (stops::shutter_times_s(Step::Third), stops::format_shutter_s),
        "camera.exposure.iso" | "noise.iso" => (stops::iso_speeds(Step::Third), stops::format_iso),
        _ => return None,
    };
    Some(Dial { stops, format })
}

impl Dial {
    /// A value as a camera shows it.
    fn text(&self, now: f64) -> String {
        if now > 0.0 { (self.format)(now) } else { "stops".to_owned() }
    }

    /// Shows the nominal value in the given width. Returns the exact value of a chosen stop.
    fn show(&self, ui: &mut Ui, called: &str, now: f64, width: f32) -> Option<f64> {
        let mut chosen = None;
        let button = egui::Button::new(self.text(now)).min_size(egui::vec2(STOPS.min(width), 0.0)).truncate();
        let layout = egui::Layout::left_to_right(egui::Align::Center);
        let room = egui::vec2(width, ui.spacing().interact_size.y);
        let menu = |ui: &mut Ui| {
            let opens = has_just_opened(ui);
            egui::ScrollArea::vertical().max_height(360.0).show(ui, |ui| {
                for stop in &self.stops {
                    let is_now = (stop.exact / now).log2().abs() < 1.0 / 12.0;
                    let label = ui.selectable_label(is_now, (self.format)(stop.exact));
                    if is_now && opens {
                        label.scroll_to_me(Some(egui::Align::Center));
                    }
                    if label.clicked() {
                        chosen = Some(rounded(stop.exact));
                        ui.close();
                    }
                }
            });
        };
        let (button, _) =
            ui.allocate_ui_with_layout(room, layout, |ui| MenuButton::from_button(button).ui(ui, menu)).inner;
        let info = || egui::WidgetInfo::labeled(egui::Role::Button, true, format!("{called}: stops"));
        button.widget_info(info);
        button.on_hover_text("A camera's stops, in thirds");
        chosen
    }
}

/// First value of a parameter that had none.
fn first_value(full: &str, kind: &Kind) -> Value {
    // Parameters for which 1 is not plausible.
    match full {
        "camera.exposure.time_s" => return Value::Number(0.016),
        "camera.exposure.shutter_angle_deg" => return Value::Number(180.0),
        "camera.exposure.iso" | "noise.iso" => return Value::Number(400.0),
        "camera.lens.f_number" => return Value::Number(4.0),
        _ => {}
    }
    match kind {
        Kind::Bool => Value::Bool(true),
        Kind::Choice(names) => Value::Text(names.first().copied().unwrap_or_default().to_owned()),
        Kind::Number { min, max } | Kind::Integer { min, max } => Value::Number(1f64.clamp(*min, *max)),
        Kind::Points | Kind::LensTable => Value::None,
    }
}

/// The control itself, with its accessible name. A double-click sets `reset`.
fn field(
    ui: &mut Ui,
    called: &str,
    spec: &Spec,
    value: &mut Value,
    reset: &Value,
    has_slider: bool,
) -> Option<ValueChange> {
    match (&spec.kind, value) {
        (Kind::Bool, Value::Bool(on)) => {
            let response = ui.checkbox(on, "");
            response.widget_info(|| egui::WidgetInfo::selected(egui::Role::CheckBox, true, *on, called));
            response.changed().then_some(ValueChange::set(Value::Bool(*on)))
        }
        (Kind::Choice(names), Value::Text(chosen)) => {
            let before = chosen.clone();
            let combo = egui::ComboBox::from_id_salt(called).selected_text(chosen.as_str()).truncate();
            let response = combo.show_ui(ui, |ui| {
                for name in *names {
                    ui.selectable_value(chosen, (*name).to_owned(), *name);
                }
            });
            let info = || egui::WidgetInfo::labeled(egui::Role::ComboBox, true, called);
            response.response.widget_info(info);
            (*chosen != before).then(|| ValueChange::set(Value::Text(chosen.clone())))
        }
        // Profiles have them.
        (Kind::Points, Value::Text(points)) => {
            let response = ui.weak(format!("{} points", points.split(',').count()));
            response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Label, true, called));
            None
        }
        (Kind::LensTable, Value::Text(_)) => {
            let response = ui.weak("of the profile");
            response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Label, true, called));
            None
        }
        (Kind::Number { .. } | Kind::Integer { .. }, Value::Number(n)) => {
            numeric(ui, called, spec, n, reset, has_slider)
        }
        _ => None,
    }
}

/// Largest range of a linear slider. Sliders with a ratio scale have no limit.
const MAX_LINEAR_RANGE: f64 = 1e4;

fn numeric(
    ui: &mut Ui,
    called: &str,
    spec: &Spec,
    n: &mut f64,
    reset: &Value,
    has_slider: bool,
) -> Option<ValueChange> {
    let (min, max, whole) = match spec.kind {
        Kind::Number { min, max } => (min, max, false),
        Kind::Integer { min, max } => (min, max, true),
        _ => return None,
    };
    let unit = suffix(spec, *n);
    let scale = SliderScale { min, max, by_ratio: spec.by_ratio, whole };
    let (response, is_twice) = if has_slider && (max - min <= MAX_LINEAR_RANGE || spec.by_ratio) {
        slider::show(ui, called, n, scale, &unit)
    } else {
        let speed = if whole { 1.0 } else { (0.002 * n.abs()).max(1e-4) };
        let drag =
            egui::DragValue::new(n).range(min..=max).speed(speed).suffix(unit).custom_parser(typed_parser(ui.ctx()));
        let drag = drag.clip_text(true);
        let response = ui.add(drag.custom_formatter(|n, _| short(n)).update_while_editing(false));
        response.widget_info(|| egui::WidgetInfo::slider(true, *n, called));
        let is_twice = response.double_clicked();
        (response, is_twice)
    };
    if is_twice {
        return Some(ValueChange::reset(reset.clone()));
    }
    let to = response.changed().then(|| Value::Number(rounded_value(*n, scale)));
    // The last change and the end of a drag can arrive together.
    let is_done = response.drag_stopped() || response.lost_focus();
    (to.is_some() || is_done).then_some(ValueChange { to, resets: false, is_done })
}

/// Origin marker: a dot for values of the user, a ring for values of a file.
fn origin_marker(ui: &mut Ui, origin: Origin) {
    let (rect, response) = ui.allocate_exact_size(egui::vec2(8.0, 18.0), egui::Sense::hover());
    let color = Color32::from_rgb(230, 159, 0);
    match origin {
        Origin::User => _ = ui.painter().circle_filled(rect.center(), 3.0, color),
        Origin::File | Origin::Scene => {
            let stroke = egui::Stroke::new(1.2, ui.visuals().text_color());
            ui.painter().circle_stroke(rect.center(), 2.6, stroke);
        }
        Origin::Default => {}
    }
    let hint = match origin {
        Origin::User => "Changed by you",
        Origin::File => "From the recording or a profile",
        Origin::Scene => "Kept by the scene, as the profile has it. Double-click the name to follow the profile",
        Origin::Default => "Its default",
    };
    response.on_hover_text(hint);
}
