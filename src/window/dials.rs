//! Dials of the virtual camera for photographs.

use std::path::PathBuf;

use eframe::egui::{self, RichText, Ui};

use super::fields::{has_just_opened, parse_number, typed_parser};
use locard_engine::camera::Film;
use locard_engine::camera::stops::{self, Step, Stop, StopError};
use locard_engine::photo::{Bracket, Focus, PhotoRequest};
use locard_engine::text::without_options;

/// Text of the fields; empty for automatic values.
#[derive(Clone, Debug, Default)]
pub struct Dials {
    f_number: String,
    shutter: String,
    iso: String,
    focal: String,
    focus: String,
    film: String,
    width: String,
    aim: String,
    lux: String,
    compensation_ev: f64,
    hand_held: bool,
    bracket: Option<Bracket>,
}

const FILMS: [&str; 7] = ["36x24", "aps-c", "aps-c-canon", "micro-4/3", "1in", "1/2.3in", "6x6"];

impl Dials {
    /// Shows the dials. Returns the settings of a photograph when the button is pressed, without
    /// its path.
    pub fn show(&mut self, ui: &mut Ui, frame: usize) -> Option<PhotoRequest> {
        let marked = |stops: Vec<Stop>, format: fn(f64) -> String| -> Vec<String> {
            stops.into_iter().map(|stop| format(stop.exact)).collect()
        };
        egui::Grid::new("dials").num_columns(2).spacing([12.0, 4.0]).show(ui, |ui| {
            let apertures = || marked(stops::f_numbers(Step::Third), stops::format_f_number);
            let times = || marked(stops::shutter_times_s(Step::Third), stops::format_shutter_s);
            let speeds = || marked(stops::iso_speeds(Step::Third), stops::format_iso);
            dial(ui, "Aperture", "automatic", &mut self.f_number, apertures);
            dial(ui, "Shutter", "automatic", &mut self.shutter, times);
            dial(ui, "ISO", "as recorded", &mut self.iso, speeds);
            dial(ui, "Focal length, mm", "as recorded", &mut self.focal, Vec::new);
            dial(ui, "Focus, m", "the middle of the picture", &mut self.focus, || vec!["infinity".to_owned()]);
            dial(ui, "Sensor size", "as recorded", &mut self.film, || FILMS.map(str::to_owned).to_vec());
            dial(ui, "Aim at", "X,Y or an object's name", &mut self.aim, Vec::new);
            dial(ui, "Width, px", "as recorded", &mut self.width, Vec::new);
            dial(ui, "Light, lx", "from the picture", &mut self.lux, Vec::new);
            ui.label("Compensation");
            let drag = egui::DragValue::new(&mut self.compensation_ev)
                .range(-5.0..=5.0)
                .speed(0.05)
                .suffix(" EV")
                .update_while_editing(false);
            ui.add(drag.custom_parser(typed_parser(ui.ctx())))
                .widget_info(|| egui::WidgetInfo::labeled(egui::Role::SpinButton, true, "Compensation"));
            ui.end_row();
            ui.label("Bracket");
            let name = |bracket: Option<Bracket>| match bracket {
                None => "off",
                Some(Bracket::Aperture) => "by aperture",
                Some(Bracket::Shutter) => "by shutter time",
                Some(Bracket::Iso) => "by ISO",
                Some(Bracket::Focus) => "by focus distance",
            };
            let all = [None, Some(Bracket::Aperture), Some(Bracket::Shutter), Some(Bracket::Iso), Some(Bracket::Focus)];
            let series = egui::ComboBox::from_id_salt("bracket").selected_text(name(self.bracket)).show_ui(ui, |ui| {
                for bracket in all {
                    ui.selectable_value(&mut self.bracket, bracket, name(bracket));
                }
            });
            series.response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::ComboBox, true, "Bracket"));
            ui.end_row();
        });
        let hover_text = "The camera moves while the shutter is open, as the recording's did: its frames are summed";
        ui.checkbox(&mut self.hand_held, "Hand-held").on_hover_text(hover_text);
        let request = self.request(frame);
        if let Err(why) = &request {
            ui.add(egui::Label::new(RichText::new(why).color(ui.visuals().error_fg_color)).wrap());
        }
        let button = ui.add_enabled(request.is_ok(), egui::Button::new("Photograph…"));
        let button =
            button.on_hover_text("The frame that is shown, as the virtual camera takes it: JPEG or PNG with EXIF");
        request.ok().filter(|_| button.clicked())
    }

    /// Settings of the dials, or the error of one that cannot be parsed.
    fn request(&self, frame: usize) -> Result<PhotoRequest, String> {
        Ok(PhotoRequest {
            f_number: read("Aperture", &self.f_number, |text| stop(stops::parse_f_number(text)))?,
            time_s: read("Shutter", &self.shutter, |text| stop(stops::parse_shutter_s(text)))?,
            iso: read("ISO", &self.iso, |text| stop(stops::parse_iso(text)))?,
            compensation_ev: self.compensation_ev,
            lux: read("Light", &self.lux, |text| number(text, 1e-6, 1e7))?,
            focal_length_mm: read("Focal length", &self.focal, |text| {
                number(text.trim_end_matches("mm"), 1.0, 5000.0)
            })?,
            aim: Some(self.aim.trim().to_owned()).filter(|aim| !aim.is_empty()),
            hand_held: self.hand_held,
            focus: read("Focus", &self.focus, |text| match text {
                "inf" | "infinity" | "∞" => Ok(Focus::Metres(f64::INFINITY)),
                text => number(text.trim_end_matches('m'), 0.01, 1e5).map(Focus::Metres),
            })?
            .unwrap_or(Focus::Auto),
            film: read("Sensor size", &self.film, |text| text.parse::<Film>().map_err(|error| error.to_string()))?,
            width_px: read("Width", &self.width, |text| number(text, 16.0, 2e4).map(|width| width.round() as u32))?,
            bracket: self.bracket,
            ..PhotoRequest::new(frame, PathBuf::new())
        })
    }
}

/// Options of the command line with the labels of their dials.
const OPTIONS: [(&str, &str); 13] = [
    ("--aperture", "Aperture"),
    ("--shutter", "Shutter"),
    ("--iso", "ISO"),
    ("--focal", "Focal length"),
    ("--focus", "Focus"),
    ("--film", "Sensor size"),
    ("--aim", "Aim at"),
    ("--width", "Width"),
    ("--lux", "Light"),
    ("--compensation", "Compensation"),
    ("--bracket", "Bracket"),
    ("--hand-held", "Hand-held"),
    ("--mode", "mode"),
];

/// Replaces options of the command line in a message by the labels of dials.
pub fn options_as_dials(text: &str) -> String {
    OPTIONS.iter().fold(without_options(text), |text, (option, dial)| text.replace(option, dial))
}

fn stop(read: Result<f64, StopError>) -> Result<f64, String> {
    read.map_err(|error| error.to_string())
}

fn number(text: &str, min: f64, max: f64) -> Result<f64, String> {
    let accepted = format!("expected {} to {}", locard_engine::text::number(min), locard_engine::text::number(max));
    parse_number(text).filter(|number| (min..=max).contains(number)).ok_or(accepted)
}

/// Parses a field; `None` if it is empty.
fn read<T>(dial: &str, text: &str, parse: impl FnOnce(&str) -> Result<T, String>) -> Result<Option<T>, String> {
    // Accepts a decimal comma. The aim, X,Y, is not parsed here.
    let text = text.trim().replace(',', ".");
    if text.is_empty() {
        return Ok(None);
    }
    parse(&text).map(Some).map_err(|why| format!("{dial}: {why}"))
}

/// A camera's value without prefix and unit: f/8, 8 and 8,0 are equal.
fn normalized_value(text: &str) -> String {
    let text = text.trim().replace(',', ".");
    let text = text.trim_start_matches("f/").trim_start_matches("ISO").trim_end_matches('s').trim();
    text.parse::<f64>().map_or_else(|_| text.to_owned(), locard_engine::text::number)
}

/// A text field with a menu of nominal values.
fn dial(ui: &mut Ui, name: &str, empty: &str, text: &mut String, values: impl FnOnce() -> Vec<String>) {
    ui.label(name);
    ui.horizontal(|ui| {
        let field = egui::TextEdit::singleline(text).desired_width(150.0).hint_text(empty);
        ui.add(field).widget_info(|| egui::WidgetInfo::labeled(egui::Role::TextInput, true, name));
        let values = values();
        if values.is_empty() {
            return;
        }
        let menu = ui.menu_button("…", |ui| {
            let opens = has_just_opened(ui);
            egui::ScrollArea::vertical().max_height(260.0).show(ui, |ui| {
                if ui.button(empty).clicked() {
                    text.clear();
                    ui.close();
                }
                for value in values {
                    let is_now = normalized_value(text) == normalized_value(&value);
                    let button = ui.selectable_label(is_now, &value);
                    if is_now && opens {
                        button.scroll_to_me(Some(egui::Align::Center));
                    }
                    if button.clicked() {
                        *text = value;
                        ui.close();
                    }
                }
            });
        });
        menu.response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, format!("{name}: values")));
    });
    ui.end_row();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_in_messages_become_dial_labels() {
        let text = options_as_dials("--aim 9,9 lies outside the picture, 4x4 px (--force); a smaller --iso helps");
        assert_eq!(text, "Aim at 9,9 lies outside the picture, 4x4 px; a smaller ISO helps");
    }

    #[test]
    fn typed_value_matches_its_menu_entry() {
        for (typed, marked) in
            [("8", "f/8"), ("5,60", "f/5.6"), ("1/500", "1/500 s"), ("6400", "ISO 6400"), ("2", "2 s")]
        {
            assert_eq!(normalized_value(typed), normalized_value(marked), "{typed}");
        }
        assert_ne!(normalized_value("8"), normalized_value("f/80"));
    }

    #[test]
    fn typed_dials_become_photograph_settings() {
        let dials = Dials {
            f_number: "f/2,8".to_owned(),
            shutter: "1/60".to_owned(),
            iso: "400".to_owned(),
            focal: "50 mm".to_owned(),
            focus: "1,5 m".to_owned(),
            film: "36x24".to_owned(),
            width: "1200".to_owned(),
            aim: " 320,240 ".to_owned(),
            ..Dials::default()
        };
        let request = dials.request(7).unwrap();
        let f_number = stops::parse_f_number("2.8").unwrap();
        assert_eq!(
            (request.frame, request.f_number, request.iso),
            (7, Some(f_number), Some(stops::parse_iso("400").unwrap()))
        );
        assert_eq!((request.focal_length_mm, request.focus), (Some(50.0), Focus::Metres(1.5)));
        assert_eq!((request.width_px, request.aim.as_deref()), (Some(1200), Some("320,240")));
        assert_eq!(Dials::default().request(7).unwrap(), PhotoRequest::new(7, PathBuf::new()));
        let wrong = Dials { iso: "fast".to_owned(), ..Dials::default() }.request(0).unwrap_err();
        assert!(wrong.starts_with("ISO: "), "{wrong}");
        let wrong = Dials { focus: "0".to_owned(), ..Dials::default() }.request(0).unwrap_err();
        assert!(wrong.contains("0.01 to 100000"), "{wrong}");
    }
}
