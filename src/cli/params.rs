//! `locard params`.

use std::io::Write;

use anyhow::{Result, bail};
use serde_json::json;

use locard_engine::compositor::{ON, Settings};
use locard_engine::params::{Params, Value};
use locard_engine::profile::Rig;
use locard_engine::stage::Stage;
use locard_engine::text::shown_unit;

#[derive(clap::Args)]
#[command(after_help = "[stage] after a parameter: the first stage that a change recomputes")]
pub struct Args {
    /// List this table and those below it, as in noise or camera, or one parameter, as in
    /// noise.scale; all by default
    #[arg(value_name = "TABLE|PARAMETER")]
    name: Option<String>,
    /// As JSON
    #[arg(long)]
    json: bool,
}

/// True for a table, and for the tables below it: `camera.lens` of `camera`.
fn is_at_or_below(table: &str, name: &str) -> bool {
    table.strip_prefix(name).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
}

pub fn run(args: &Args) -> Result<()> {
    let (rig, settings) = (Rig::default(), Settings::default());
    let mut tables: Vec<&dyn Params> = rig.tables().into_iter().chain(settings.tables()).collect();
    // A parameter's name, if that alone is listed.
    let mut parameter = None;
    if let Some(name) = &args.name {
        let names: Vec<&str> = tables.iter().map(|table| table.table()).collect();
        let has = |table: &&dyn Params, own: &str| table.specs().iter().any(|spec| spec.name == own);
        let of_parameter = name.rsplit_once('.').and_then(|(table, own)| {
            let table = tables.iter().find(|candidate| candidate.table() == table && has(candidate, own))?;
            Some((*table, own))
        });
        tables.retain(|table| is_at_or_below(table.table(), name));
        if let (true, Some((table, own))) = (tables.is_empty(), of_parameter) {
            (tables, parameter) = (vec![table], Some(own));
        }
        if tables.is_empty() {
            bail!("there is no table or parameter {name}; tables: {}", names.join(", "));
        }
    }
    let is_listed = |name: &str| parameter.is_none_or(|parameter| parameter == name);
    let mut out = std::io::stdout().lock();
    if args.json {
        let list: Vec<_> = tables
            .iter()
            .flat_map(|t| t.specs().into_iter().map(|s| (t.table(), s)))
            .filter(|(_, s)| is_listed(s.name))
            .map(|(table, s)| {
                let default = match &s.default {
                    Value::None => json!(null),
                    Value::Bool(b) => json!(b),
                    Value::Number(n) => json!(n),
                    Value::Text(t) => json!(t),
                };
                json!({
                    "table": table, "name": s.name, "unit": s.unit, "accepts": s.kind.to_string(),
                    "optional": s.optional, "default": default, "help": s.help,
                    "acts": s.acts_if.map(|acts_if| acts_if.to_string()),
                    "stage": s.stage.map(|stage| stage.to_string()),
                })
            })
            .collect();
        writeln!(out, "{}", serde_json::to_string_pretty(&list)?)?;
        return Ok(());
    }
    let stages: Vec<String> = Stage::ALL.iter().map(Stage::to_string).collect();
    writeln!(out, "[stage]: the first stage that a change recomputes, of {}\n", stages.join(", "))?;
    for table in tables {
        let summary = settings.effects().find(|e| e.table() == table.table()).map(|e| e.summary());
        match summary {
            Some(summary) => writeln!(out, "[{}]  {summary}", table.table())?,
            None => writeln!(out, "[{}]", table.table())?,
        }
        for s in table.specs().into_iter().filter(|s| is_listed(s.name)) {
            // Without a default, the unit is printed after the range.
            let (unit, of_range) = match s.default {
                Value::None => (String::new(), shown_unit(s.unit)),
                _ => (shown_unit(s.unit), String::new()),
            };
            let or_none = if s.optional { ", or none" } else { "" };
            writeln!(out, "  {} = {}{unit}    ({}{of_range}{or_none})", s.name, s.default, s.kind)?;
            match s.stage {
                Some(stage) => writeln!(out, "      {} [{stage}]", s.help)?,
                None => writeln!(out, "      {}", s.help)?,
            }
            if let Some(acts_if) = s.acts_if {
                writeln!(out, "      (acts {acts_if})")?;
            }
        }
        writeln!(out)?;
    }
    writeln!(
        out,
        "A change recomputes its [stage] and those after it; from depth on, if an effect then reaches over more pixels."
    )?;
    writeln!(out, "Every effect also has `{ON} = true    (true or false)`: without, it does not run.")?;
    Ok(())
}
