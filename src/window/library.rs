//! The library of models to place, with rendered thumbnails.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Sender, channel};

use eframe::egui::{self, Color32, ColorImage, FocusDirection, Id, Key, TextureHandle, Ui, vec2};
use glam::DVec3;

use super::task::BackgroundTask;
use locard_engine::assets;
use locard_engine::camera::{Distortion, Geometry, Intrinsics, Response};
use locard_engine::gpu::Gpu;
use locard_engine::pixels::LinearImage;
use locard_engine::pose::Pose;
use locard_engine::render::{PictureRequest, Projection, Renderer, take_still};
use locard_engine::scene::{self, Scene, is_model};

/// Rendered size of a thumbnail, px.
const THUMBNAIL_PX: u32 = 160;
/// Displayed size of a thumbnail, points.
const THUMBNAIL_PT: f32 = 80.0;
const COLUMNS: usize = 3;
const GAP_PT: f32 = 6.0;
/// Direction to the camera in a model's axes: from the front, one side and above.
const VIEW_FROM: DVec3 = DVec3::new(0.5, 0.6, 1.0);
/// Distance of the camera in radii of the bounding sphere.
const VIEW_DISTANCE_RADII: f64 = 5.0;

/// Thumbnail of a model.
enum Thumbnail {
    Requested,
    Ready(TextureHandle),
    Failed(String),
}

/// Renders thumbnails on a thread of its own.
struct ThumbnailRenderer {
    requests: Sender<PathBuf>,
    results: BackgroundTask<(PathBuf, Result<ColorImage, String>)>,
}

/// The models beside the scene file and those that are installed with the program.
#[derive(Default)]
pub struct Library {
    models: Vec<PathBuf>,
    /// Folder of the scene file at the last scan. No memo: models of other folders are added to
    /// `models`.
    scanned: Option<PathBuf>,
    /// No memo: a requested thumbnail arrives later, from a thread.
    thumbnails: HashMap<PathBuf, Thumbnail>,
    renderer: Option<ThumbnailRenderer>,
    /// The pass of the window in which the library was last shown.
    last_pass: u64,
    /// Opened by a key: the first model gets the keyboard focus.
    focuses_first: bool,
}

impl Library {
    /// Scans for the models of a scene file, once per folder.
    pub fn scan(&mut self, scene: &Path) {
        let folder =
            scene.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_owned();
        if self.scanned.as_ref() == Some(&folder) {
            return;
        }
        let folders = [folder.clone(), assets::path("scenes"), assets::path("scenes/kit")];
        let mut models: Vec<PathBuf> = folders
            .iter()
            .filter_map(|folder| std::fs::read_dir(folder).ok())
            .flat_map(|entries| sorted_models(entries.flatten().map(|entry| entry.path())))
            .collect();
        let mut canonical_paths = std::collections::BTreeSet::new();
        models.retain(|path| canonical_paths.insert(std::fs::canonicalize(path).unwrap_or_else(|_| path.clone())));
        self.models = models;
        self.scanned = Some(folder);
    }

    /// Adds a model from another folder.
    pub fn add(&mut self, model: &Path) {
        if !self.models.iter().any(|known| known == model) {
            self.models.push(model.to_owned());
        }
    }

    /// Shows the models. Returns a chosen one.
    pub fn show(&mut self, ui: &mut Ui, gpu: &Gpu) -> Option<PathBuf> {
        self.take_results(ui.ctx());
        if self.models.is_empty() {
            let folders: Vec<String> =
                assets::folders().iter().map(|folder| folder.join("scenes").display().to_string()).collect();
            let text =
                format!("No .glb beside the scene file, nor in {}. Drop one into the window.", folders.join(", "));
            ui.add(egui::Label::new(text).wrap());
            return None;
        }
        let mut chosen = None;
        let models = self.models.clone();
        self.move_focus(ui, &models);
        // Height of a row.
        let row = THUMBNAIL_PT + ui.text_style_height(&egui::TextStyle::Small) + 10.0 + GAP_PT;
        // Whole rows only: a clipped row would lose its names.
        let room = ui.ctx().content_rect().bottom() - ui.cursor().top() - 16.0;
        let rows = (room / row).floor().clamp(1.0, 4.0);
        let area =
            egui::ScrollArea::vertical().max_height(rows * row - GAP_PT).min_scrolled_height(rows * row - GAP_PT);
        area.show(ui, |ui| {
            egui::Grid::new("library").spacing([GAP_PT, GAP_PT]).show(ui, |ui| {
                for (n, model) in models.iter().enumerate() {
                    if self.entry(ui, gpu, model) {
                        chosen = Some(model.clone());
                    }
                    if n % COLUMNS == COLUMNS - 1 {
                        ui.end_row();
                    }
                }
            });
        });
        chosen
    }

    /// Keyboard focus: on the first model when opened by a key; arrows and Tab move it.
    fn move_focus(&mut self, ui: &Ui, models: &[PathBuf]) {
        let ctx = ui.ctx();
        let pass = ctx.cumulative_pass_nr();
        let opens = self.last_pass + 1 < pass;
        self.last_pass = pass;
        if opens {
            self.focuses_first = !ctx.input(|i| i.pointer.any_click());
        }
        // The sizing pass is not visible.
        if ui.is_sizing_pass() {
            return;
        }
        let at = models.iter().position(|model| ctx.memory(|memory| memory.has_focus(id(model))));
        let to = match at {
            None => std::mem::take(&mut self.focuses_first).then_some(0),
            Some(at) => {
                // Otherwise egui moves the focus to the nearest button elsewhere.
                ctx.memory_mut(|memory| memory.move_focus(FocusDirection::None));
                ctx.input(|input| {
                    focus_target(
                        |key, shift| input.modifiers.shift == shift && input.key_pressed(key),
                        at,
                        models.len(),
                    )
                })
            }
        };
        if let Some(model) = to.and_then(|to| models.get(to)) {
            ctx.memory_mut(|memory| memory.request_focus(id(model)));
        }
    }

    /// Shows one model. Returns true if it was clicked.
    fn entry(&mut self, ui: &mut Ui, gpu: &Gpu, model: &Path) -> bool {
        let line = ui.text_style_height(&egui::TextStyle::Small);
        let (_, rect) = ui.allocate_space(vec2(THUMBNAIL_PT + 8.0, THUMBNAIL_PT + line + 10.0));
        let response = ui.interact(rect, id(model), egui::Sense::click());
        if response.gained_focus() {
            response.scroll_to_me(None);
        }
        let called = name(model);
        response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, &called));
        if !ui.is_rect_visible(rect) {
            return response.clicked();
        }
        let visuals = ui.style().interact(&response);
        let painter = ui.painter();
        painter.rect_filled(rect, visuals.corner_radius, visuals.weak_bg_fill);
        if response.has_focus() || response.hovered() {
            painter.rect_stroke(rect, visuals.corner_radius, visuals.fg_stroke, egui::StrokeKind::Inside);
        }
        let picture = egui::Rect::from_min_size(rect.min + vec2(4.0, 4.0), vec2(THUMBNAIL_PT, THUMBNAIL_PT));
        let whole = egui::Rect::from_min_max(egui::pos2(0.0, 0.0), egui::pos2(1.0, 1.0));
        let problem = match self.thumbnails.get(model) {
            Some(Thumbnail::Ready(texture)) => {
                painter.image(texture.id(), picture, whole, Color32::WHITE);
                None
            }
            Some(Thumbnail::Failed(why)) => {
                let font = egui::TextStyle::Body.resolve(ui.style());
                painter.text(picture.center(), egui::Align2::CENTER_CENTER, "?", font, ui.visuals().error_fg_color);
                Some(why.clone())
            }
            Some(Thumbnail::Requested) => None,
            None => {
                self.request_thumbnail(ui.ctx(), gpu, model);
                None
            }
        };
        let font = egui::TextStyle::Small.resolve(ui.style());
        let mut job = egui::text::LayoutJob::simple_singleline(called, font, visuals.text_color());
        job.wrap = egui::text::TextWrapping::truncate_at_width(THUMBNAIL_PT);
        let text = ui.painter().layout_job(job);
        let at = egui::pos2(rect.center().x - 0.5 * text.size().x, picture.bottom() + 2.0);
        ui.painter().galley(at, text, visuals.text_color());
        let hover = problem.unwrap_or_else(|| model.display().to_string());
        response.on_hover_text(hover).clicked()
    }

    fn request_thumbnail(&mut self, ctx: &egui::Context, gpu: &Gpu, model: &Path) {
        if self.renderer.is_none() {
            self.renderer = ThumbnailRenderer::new(gpu.clone(), ctx.clone()).ok();
        }
        let sent = self.renderer.as_ref().is_some_and(|renderer| renderer.requests.send(model.to_owned()).is_ok());
        let thumbnail = if sent {
            Thumbnail::Requested
        } else {
            Thumbnail::Failed("the drawing thread could not be started".to_owned())
        };
        self.thumbnails.insert(model.to_owned(), thumbnail);
    }

    fn take_results(&mut self, ctx: &egui::Context) {
        let Some(renderer) = &self.renderer else { return };
        while let Some(taken) = renderer.results.take() {
            let (model, result) = match taken {
                Ok(result) => result,
                Err(why) => {
                    // The requested models have no thumbnail; later ones start another thread.
                    let requested = self.thumbnails.values_mut().filter(|one| matches!(one, Thumbnail::Requested));
                    requested.for_each(|thumbnail| *thumbnail = Thumbnail::Failed(why.clone()));
                    self.renderer = None;
                    return;
                }
            };
            let thumbnail = match result {
                Ok(image) => Thumbnail::Ready(ctx.load_texture(name(&model), image, egui::TextureOptions::LINEAR)),
                Err(why) => Thumbnail::Failed(why),
            };
            self.thumbnails.insert(model, thumbnail);
        }
    }
}

/// Models among files, by name; numbers in names count as numbers: `marker-9` before `marker-10`.
fn sorted_models(files: impl Iterator<Item = PathBuf>) -> Vec<PathBuf> {
    let mut models: Vec<PathBuf> = files.filter(|path| is_model(path)).collect();
    models.sort_by_cached_key(|path| {
        let name = name(path);
        let end = name.trim_end_matches(|c: char| c.is_ascii_digit()).len();
        (name[..end].to_owned(), name[end..].parse::<u64>().ok(), name)
    });
    models
}

/// Widget id of a model.
fn id(model: &Path) -> Id {
    Id::unique(("model", model))
}

/// Index that gets the focus from `at` by the pressed key, without or with Shift: arrows move in
/// the grid, Tab wraps around.
fn focus_target(pressed: impl Fn(Key, bool) -> bool, at: usize, count: usize) -> Option<usize> {
    let keys = [
        (Key::ArrowLeft, false, at.checked_sub(1)),
        (Key::ArrowRight, false, Some(at + 1)),
        (Key::ArrowUp, false, at.checked_sub(COLUMNS)),
        // The row below may be shorter.
        (Key::ArrowDown, false, Some((at + COLUMNS).min(count - 1)).filter(|to| to / COLUMNS > at / COLUMNS)),
        (Key::Tab, false, Some((at + 1) % count)),
        (Key::Tab, true, Some((at + count - 1) % count)),
    ];
    let (.., to) = keys.into_iter().find(|(key, shift, _)| pressed(*key, *shift))?;
    to.filter(|to| *to < count)
}

/// Name of a model: its file stem.
pub fn name(model: &Path) -> String {
    model.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

impl ThumbnailRenderer {
    /// Ends when the library is dropped.
    fn new(gpu: Gpu, ctx: egui::Context) -> std::io::Result<Self> {
        let (requests, received) = channel::<PathBuf>();
        let wake = move || ctx.request_repaint();
        let results = BackgroundTask::stream("model previews", wake, move |reporter| {
            let mut renderer: Option<Renderer> = None;
            for model in received {
                let picture = gpu.in_error_scope(|| render_thumbnail(&gpu, &mut renderer, &model));
                let picture = picture.map_err(|error| error.to_string()).and_then(|picture| picture);
                if !reporter.send((model, picture)) {
                    return;
                }
            }
        })?;
        Ok(Self { requests, results })
    }
}

fn render_thumbnail(gpu: &Gpu, renderer: &mut Option<Renderer>, model: &Path) -> Result<ColorImage, String> {
    let scene = scene::load(model, Some(DVec3::Y)).map_err(|error| error.to_string())?;
    let still = still(&scene).ok_or_else(|| format!("{}: it has nothing visible", model.display()))?;
    // The first thumbnail compiles the pipelines.
    let renderer = match renderer {
        Some(renderer) => {
            renderer.set_scene(gpu, scene);
            renderer
        }
        None => renderer.insert(Renderer::new(gpu, scene)),
    };
    let image = take_still(gpu, renderer, &still).map_err(|error| error.to_string())?;
    Ok(encode(&image))
}

/// A view of the whole scene.
fn still(scene: &Scene) -> Option<PictureRequest> {
    let points = || scene.objects.iter().flat_map(|object| object.points_m(scene));
    let (low, high) = points().map(|p| (p, p)).reduce(|(low, high), (p, _)| (low.min(p), high.max(p)))?;
    let middle = 0.5 * (low + high);
    let radius = points().map(|p| p.distance(middle)).fold(1e-4, f64::max);
    let side = f64::from(THUMBNAIL_PX);
    // The near plane is at 1 cm. The bounding sphere fills 96 % of the picture.
    let distance = (VIEW_DISTANCE_RADII * radius).max(radius + 0.02);
    let focal_px = 0.48 * side * (distance * distance - radius * radius).sqrt() / radius;
    let intrinsics = Intrinsics {
        width_px: THUMBNAIL_PX,
        height_px: THUMBNAIL_PX,
        fx_px: focal_px,
        fy_px: focal_px,
        cx_px: 0.5 * side,
        cy_px: 0.5 * side,
        ..Intrinsics::default()
    };
    let pose = Pose::look_at(middle + distance * VIEW_FROM.normalize(), middle, DVec3::Y)?;
    let projection = Projection::Perspective(Geometry::new(intrinsics, Distortion::default()));
    Some(PictureRequest { projection, pose, background: false })
}

/// Gamma-encodes an image with coverage.
fn encode(image: &LinearImage) -> ColorImage {
    let response = Response::default();
    let code = |light: f32| (255.0 * response.encode(f64::from(light)).clamp(0.0, 1.0)).round() as u8;
    let pixel = |[r, g, b, a]: &[f32; 4]| {
        let [r, g, b] = [r, g, b].map(|c| if *a > 0.0 { code(c / a) } else { 0 });
        Color32::from_rgba_unmultiplied(r, g, b, (255.0 * a.clamp(0.0, 1.0)).round() as u8)
    };
    ColorImage::new([image.width as usize, image.height as usize], image.rgba.iter().map(pixel).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_move_the_focus_in_the_grid() {
        // Three in a row: 0 1 2, 3 4 5, 6.
        let to = |key, shift, at| focus_target(|pressed, with| (pressed, with) == (key, shift), at, 7);
        let way = |key| [0, 1, 4, 6].map(|at| to(key, false, at));
        assert_eq!(way(Key::ArrowRight), [Some(1), Some(2), Some(5), None]);
        assert_eq!(way(Key::ArrowLeft), [None, Some(0), Some(3), Some(5)]);
        assert_eq!(way(Key::ArrowUp), [None, None, Some(1), Some(3)]);
        assert_eq!(way(Key::ArrowDown), [Some(3), Some(4), Some(6), None]);
        assert_eq!([to(Key::Tab, false, 6), to(Key::Tab, true, 0), to(Key::Tab, true, 3)], [Some(0), Some(6), Some(2)]);
        assert_eq!(to(Key::Enter, false, 3), None);
    }

    #[test]
    fn models_are_sorted_by_name_and_number() {
        let files = ["marker-10.glb", "kit.toml", "marker-A.glb", "marker-9.glb", "arrow.glb", "l-scale.glb"];
        let sorted = sorted_models(files.into_iter().map(PathBuf::from));
        let names: Vec<String> = sorted.iter().map(|path| name(path)).collect();
        assert_eq!(names, ["arrow", "l-scale", "marker-9", "marker-10", "marker-A"]);
    }

    #[test]
    fn library_of_a_new_scene_lists_the_demonstration_models_before_the_kit() {
        let mut library = Library::default();
        library.scan(Path::new("scenes/new.toml"));
        let names: Vec<String> = library.models.iter().map(|path| name(path)).collect();
        assert_eq!(names[..3], ["cartridge-case-9mm", "l-scale", "marker-1"]);
        let at = |target: &str| names.iter().position(|name| name == target).unwrap();
        assert!(at("marker-9") < at("abfo-no-2") && at("marker-10") < at("marker-A"), "{names:?}");
    }

    #[test]
    fn thumbnail_shows_the_whole_model_within_its_borders() {
        let gpu = Gpu::open().unwrap();
        let mut renderer = None;
        // A tent marker of 10 cm and a case of 2 cm, with the same renderer.
        for model in ["scenes/marker-1.glb", "scenes/cartridge-case-9mm.glb"] {
            let image = render_thumbnail(&gpu, &mut renderer, Path::new(model)).unwrap();
            let side = THUMBNAIL_PX as usize;
            assert_eq!(image.size, [side, side]);
            let covered = |x: usize, y: usize| image.pixels[y * side + x].a() > 0;
            let rim = (0..side).flat_map(|n| [(n, 0), (n, side - 1), (0, n), (side - 1, n)]);
            assert!(covered(side / 2, side / 2) && !rim.into_iter().any(|(x, y)| covered(x, y)), "{model}");
            let share = image.pixels.iter().filter(|p| p.a() > 0).count() as f64 / (side * side) as f64;
            assert!(share > 0.1, "{model}: {share}");
        }
        assert!(render_thumbnail(&gpu, &mut renderer, Path::new("scenes/none.glb")).unwrap_err().contains("none.glb"));
    }
}
