//! The C2PA manifest of an output's file: actions, ingredients, digital source type, record.
//!
//! Source: C2PA Technical Specification 2.2, sections Actions, Ingredient and Regions of Interest.

use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use serde::Serialize;
use serde_json::{Value, json};

use locard_engine::label::DigitalSourceType;
use locard_engine::pixels::Rect;
use locard_engine::provenance::{InputRecord, WorkRecord, bytes_digest, record_path};
use locard_engine::text::count;

use super::recorded::{RecordedFile, RecordedOutput};

/// Assertion with the digest of the record, and the work of the record without its inputs.
pub const RECORD_ASSERTION: &str = "locard.record";
/// Action of rendering evidence through the camera model and blending it into the footage. The
/// specification has no such action.
const COMPOSITED: &str = "locard.composited";

/// Media type of a file, and whether the manifest is embedded in it. Of other files it is a file
/// beside them.
pub fn media_type(path: &Path) -> (&'static str, bool) {
    match path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase().as_str() {
        "png" => ("image/png", true),
        "jpg" | "jpeg" => ("image/jpeg", true),
        "mp4" | "m4v" => ("video/mp4", true),
        "mov" => ("video/quicktime", true),
        "mkv" => ("video/x-matroska", false),
        _ => ("application/octet-stream", false),
    }
}

/// Inputs of one role that are one ingredient.
struct InputGroup {
    role: String,
    title: String,
    /// Digest of the only file, or of the list of files.
    sha256: String,
    description: String,
}

impl InputGroup {
    fn of_file(input: &InputRecord) -> Self {
        Self {
            role: input.role.clone(),
            title: file_name(&input.path),
            sha256: input.sha256.clone(),
            description: format!("{}, {} bytes, SHA-256 {}", input.role, input.bytes, input.sha256),
        }
    }

    /// Files are listed as `sha256sum` lists them.
    fn of_files(role: &str, inputs: &[&InputRecord]) -> Self {
        let line = |input: &&InputRecord| format!("{}  {}\n", input.sha256, input.path.display());
        let sha256 = bytes_digest(inputs.iter().map(line).collect::<String>().as_bytes());
        let folder = inputs.first().and_then(|input| input.path.parent()).map(file_name).unwrap_or_default();
        let title = format!("{folder}, {}", count(inputs.len(), "file"));
        let description = format!("{role}, {}, SHA-256 of their list {sha256}", count(inputs.len(), "file"));
        Self { role: role.to_owned(), title, sha256, description }
    }

    fn relationship(&self) -> &'static str {
        match self.role.as_str() {
            "recording" => "parentOf",
            "scene" => "componentOf",
            _ => "inputTo",
        }
    }

    /// `number`: its own label, by which actions name it.
    fn ingredient(&self, number: usize) -> Ingredient<'_> {
        Ingredient {
            title: &self.title,
            format: "application/octet-stream",
            instance_id: named_information(&self.sha256),
            relationship: self.relationship(),
            description: &self.description,
            label: label(number),
        }
    }
}

/// An ingredient as the crate `c2pa` reads it.
#[derive(Serialize)]
struct Ingredient<'a> {
    title: &'a str,
    /// Media type.
    format: &'static str,
    instance_id: String,
    relationship: &'static str,
    description: &'a str,
    label: String,
}

/// A manifest as the crate `c2pa` reads it.
#[derive(Serialize)]
struct Definition<'a> {
    claim_generator_info: Value,
    title: String,
    /// Media type.
    format: &'static str,
    ingredients: Vec<Ingredient<'a>>,
    assertions: Value,
}

fn label(number: usize) -> String {
    format!("input-{number}")
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// A digest as a name: RFC 6920, section 3.
fn named_information(sha256: &str) -> String {
    let byte = |i: usize| sha256.get(i..i + 2).and_then(|digits| u8::from_str_radix(digits, 16).ok());
    let bytes: Vec<u8> = (0..sha256.len()).step_by(2).filter_map(byte).collect();
    format!("ni:///sha-256;{}", URL_SAFE_NO_PAD.encode(bytes))
}

/// One ingredient for the recording, one for the analysis, one for each other file.
fn input_groups(work: &WorkRecord) -> Vec<InputGroup> {
    let of_role = |role: &str| work.inputs.iter().filter(|input| input.role == role).collect::<Vec<_>>();
    let listed = ["recording", "analysis"].into_iter().filter_map(|role| match of_role(role).as_slice() {
        [] => None,
        [only] => Some(InputGroup::of_file(only)),
        several => Some(InputGroup::of_files(role, several)),
    });
    let single = work.inputs.iter().filter(|input| !matches!(input.role.as_str(), "recording" | "analysis"));
    listed.chain(single.map(InputGroup::of_file)).collect()
}

/// Actions of a work: the recording opened, the scene's files placed, all composited. A case card
/// has no recording: it is created from its data. `changed_px`: bounds and a description of each
/// changed region.
fn actions(groups: &[InputGroup], changed_px: &[(Rect, &str)]) -> Value {
    let labels = |relationship: &str| -> Vec<String> {
        let of_relationship = groups.iter().enumerate().filter(|(_, group)| group.relationship() == relationship);
        of_relationship.map(|(number, _)| label(number)).collect()
    };
    let recordings = labels("parentOf");
    if recordings.is_empty() {
        return json!([{
            "action": "c2pa.created",
            "digitalSourceType": DigitalSourceType::DataDrivenMedia.uri(),
            "parameters": { "ingredientIds": labels("inputTo") },
        }]);
    }
    let source_type = DigitalSourceType::CompositeWithSyntheticElements;
    let mut actions = vec![json!({ "action": "c2pa.opened", "parameters": { "ingredientIds": recordings } })];
    let placed = labels("componentOf");
    if !placed.is_empty() {
        actions.push(json!({
            "action": "c2pa.placed",
            "digitalSourceType": source_type.uri(),
            "parameters": { "ingredientIds": placed },
        }));
    }
    let mut composited = json!({
        "action": COMPOSITED,
        "description": source_type.description(),
        "digitalSourceType": source_type.uri(),
        "parameters": { "ingredientIds": labels("inputTo") },
    });
    let region = |(px, description): &(Rect, &str)| {
        let shape = json!({
            "type": "rectangle",
            "unit": "pixel",
            "origin": { "x": f64::from(px.x0), "y": f64::from(px.y0) },
            "width": f64::from(px.width()),
            "height": f64::from(px.height()),
        });
        json!({ "description": description, "region": [{ "type": "spatial", "shape": shape }] })
    };
    if !changed_px.is_empty() {
        composited["changes"] = changed_px.iter().map(region).collect();
    }
    actions.push(composited);
    Value::Array(actions)
}

/// Definition of the manifest of a file, as the crate `c2pa` reads it. `record_sha256`:
/// [`RecordedOutput::digest`].
pub fn definition(output: &RecordedOutput, file: &RecordedFile, record_sha256: &str) -> Value {
    let WorkRecord { program, programs, command, device, seed, inputs: _, settings } = &output.work;
    let groups = input_groups(&output.work);
    let ingredients = groups.iter().enumerate().map(|(number, group)| group.ingredient(number)).collect();
    let mut record = json!({
        "record": file_name(&record_path(&output.path)),
        "sha256": record_sha256,
        "program": program,
        "programs": programs,
        "command": command,
        "device": device,
        "seed": seed,
        "settings": settings,
    });
    if let Some(frame) = file.frame {
        record["frame"] = json!(frame);
    }
    let objects = file.changed_px.map(|px| (px, "evidence and its shadows"));
    let mark = output.mark_px().map(|px| (px, "visible mark"));
    let changed_px: Vec<(Rect, &str)> = objects.into_iter().chain(mark).collect();
    json!(Definition {
        claim_generator_info: json!([{ "name": "Locard", "version": env!("CARGO_PKG_VERSION") }]),
        title: file_name(&file.path),
        format: media_type(&file.path).0,
        ingredients,
        assertions: json!([
            { "label": "c2pa.actions.v2", "created": true, "data": { "actions": actions(&groups, &changed_px) } },
            { "label": RECORD_ASSERTION, "kind": "Json", "created": true, "data": record },
        ]),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digest_is_named_as_in_rfc_6920() {
        // RFC 6920, section 8.1: "Hello World!".
        let sha256 = "7f83b1657ff1fc53b92dc18148a1d65dfc2d4b1fa3d677284addd200126d9069";
        assert_eq!(named_information(sha256), "ni:///sha-256;f4OxZX_x_FO5LcGBSKHWXfwtSx-j1ncoSt3SABJtkGk");
        assert_eq!(bytes_digest(b"Hello World!"), sha256);
    }

    fn input(role: &str, path: &str) -> InputRecord {
        InputRecord { role: role.to_owned(), path: path.into(), bytes: 3, sha256: "ab".repeat(32) }
    }

    #[test]
    fn recording_is_one_parent_and_each_model_a_component() {
        let inputs = [
            input("recording", "r/a.png"),
            input("recording", "r/b.png"),
            input("profile", "p.toml"),
            input("scene", "s.toml"),
            input("scene", "knife.glb"),
        ];
        let groups = vec![
            InputGroup::of_files("recording", &[&inputs[0], &inputs[1]]),
            InputGroup::of_file(&inputs[2]),
            InputGroup::of_file(&inputs[3]),
            InputGroup::of_file(&inputs[4]),
        ];
        assert_eq!(groups[0].title, "r, 2 files");
        let list = format!("{0}  r/a.png\n{0}  r/b.png\n", "ab".repeat(32));
        assert_eq!(groups[0].sha256, bytes_digest(list.as_bytes()));
        let changed_px =
            [(Rect::new(2, 3, 12, 8), "evidence and its shadows"), (Rect::new(0, 9, 20, 12), "visible mark")];
        let actions = actions(&groups, &changed_px);
        assert_eq!(actions[0]["parameters"]["ingredientIds"], json!(["input-0"]));
        assert_eq!(actions[1]["parameters"]["ingredientIds"], json!(["input-2", "input-3"]));
        assert_eq!(actions[2]["parameters"]["ingredientIds"], json!(["input-1"]));
        let shape = &actions[2]["changes"][0]["region"][0]["shape"];
        assert_eq!((&shape["origin"]["y"], &shape["width"]), (&json!(3.0), &json!(10.0)));
        let mark = &actions[2]["changes"][1];
        assert_eq!(
            (&mark["description"], &mark["region"][0]["shape"]["height"]),
            (&json!("visible mark"), &json!(3.0))
        );
        assert!(actions[1]["digitalSourceType"].as_str().unwrap().ends_with("compositeSynthetic"));
    }

    #[test]
    fn picture_without_a_recording_is_created_from_its_data() {
        let actions = actions(&[InputGroup::of_file(&input("card", "case.toml"))], &[]);
        assert_eq!(actions[0]["action"], "c2pa.created");
        assert!(actions[0]["digitalSourceType"].as_str().unwrap().ends_with("dataDrivenMedia"));
        assert_eq!(actions[0]["parameters"]["ingredientIds"], json!(["input-0"]));
    }
}
