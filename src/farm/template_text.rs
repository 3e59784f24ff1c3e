//! The texts of a job template and of its parameters' values. Every text is a YAML scalar in double
//! quotes, which JSON's strings are.

use super::command::{PathParameter, Word};
use super::template::FarmJob;

fn scalar(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

fn path_scalar(parameter: &PathParameter) -> String {
    scalar(&parameter.path.to_string_lossy())
}

/// The job template.
pub(super) fn template(job: &FarmJob) -> String {
    let mut text = format!("specificationVersion: jobtemplate-2023-09\nname: {}\n", scalar(&job.template_name()));
    text += "parameterDefinitions:\n";
    text += &format!(
        "- name: Program\n  type: STRING\n  description: \"The program locard on the machines\"\n  default: {}\n",
        scalar(&job.program)
    );
    for PathParameter { name, description, object_type, data_flow, .. } in job.parameters() {
        text += &format!(
            "- name: {name}\n  type: PATH\n  description: {}\n  objectType: {object_type}\n  dataFlow: {data_flow}\n",
            scalar(description)
        );
    }
    // Runs on each machine, before its first task.
    text += "jobEnvironments:\n- name: Check\n  script:\n    actions:\n      onEnter:\n";
    text += &action(&job.check_command(), "        ");
    text += "steps:\n";
    let analyse = job.analyse_command();
    if let Some(analyse) = &analyse {
        text += &format!("- name: Analyse\n{}", script(analyse));
    }
    text += "- name: Part\n";
    if analyse.is_some() {
        text += "  dependencies:\n  - dependsOn: Analyse\n";
    }
    let ranges: Vec<String> = job.ranges().iter().map(|range| scalar(range)).collect();
    text += "  parameterSpace:\n    taskParameterDefinitions:\n    - name: Frames\n      type: STRING\n      range:\n";
    text += &ranges.iter().map(|range| format!("      - {range}\n")).collect::<String>();
    text += &script(&job.part_command());
    text + &format!("- name: Join\n  dependencies:\n  - dependsOn: Part\n{}", script(&job.join_command()))
}

/// A step's script of one command.
fn script(words: &[Word]) -> String {
    format!("  script:\n    actions:\n      onRun:\n{}", action(words, "        "))
}

fn action(words: &[Word], indentation: &str) -> String {
    let mut text = format!("{indentation}command: \"{{{{Param.Program}}}}\"\n{indentation}args:\n");
    for word in words {
        text += &format!("{indentation}- {}\n", scalar(&word.as_format_string()));
    }
    text
}

/// The parameters' values as AWS Deadline Cloud reads them from a job bundle.
pub(super) fn bundle_values(job: &FarmJob) -> String {
    let mut text = "parameterValues:\n".to_owned();
    for parameter in job.parameters() {
        text += &format!("- name: {}\n  value: {}\n", parameter.name, path_scalar(&parameter));
    }
    text
}

/// The parameters' values as `openjd run -p file://…` reads them.
pub(super) fn openjd_values(job: &FarmJob) -> String {
    job.parameters().iter().map(|parameter| format!("{}: {}\n", parameter.name, path_scalar(parameter))).collect()
}

#[cfg(test)]
mod tests {
    use super::super::cost::PartCost;
    use super::super::ranges::FarmPlan;
    use super::*;

    fn job() -> FarmJob {
        FarmJob {
            name: "demo".to_owned(),
            plan: FarmPlan::new(0..72, 4, 1).unwrap(),
            program: "locard".to_owned(),
            build: "b1".to_owned(),
            adapter_kind: Some("Cpu".to_owned()),
            recording: "/r/demo".into(),
            scene: "/s/it's".into(),
            profile: None,
            analysis: None,
            analyses: false,
            analysis_options: Vec::new(),
            options: vec!["--set".to_owned(), "noise.scale=0.5".to_owned()],
            parts_folder: "/j/parts-4".into(),
            extension: None,
            sound: true,
            out: "/o".into(),
            cost: None,
        }
    }

    fn file(job: &FarmJob, name: &str) -> String {
        job.files().unwrap().into_iter().find(|file| file.0 == name).unwrap().1
    }

    #[test]
    fn all_engines_get_the_same_ranges() {
        let job = job();
        let ranges = ["0..18", "18..36", "36..54", "54..72"];
        assert_eq!(file(&job, "parts.txt"), ranges.join("\n") + "\n");
        let template = file(&job, "template.yaml");
        assert!(
            template
                .contains("range:\n      - \"0..18\"\n      - \"18..36\"\n      - \"36..54\"\n      - \"54..72\"\n")
        );
        let slurm = file(&job, "slurm.sh");
        assert!(slurm.contains("ranges=(0..18 18..36 36..54 54..72)\n") && slurm.contains("--array=0-3 "), "{slurm}");
        assert!(!slurm.contains("--time"));
        assert!(template.contains("- \"--frames\"\n        - \"0..72\"\n        - \"--force\"\n"), "{template}");
    }

    #[test]
    fn analysis_is_a_step_before_the_parts_and_an_input_of_all() {
        let job = FarmJob { analyses: true, analysis: Some("/r/demo.analysis".into()), ..job() };
        let template = file(&job, "template.yaml");
        let [analyse, part, join] =
            ["- name: Analyse", "- name: Part\n", "- name: Join"].map(|step| template.find(step).unwrap());
        assert!(analyse < part && part < join);
        assert!(template[part..join].contains("dependsOn: Analyse"), "{template}");
        assert!(template[part..join].contains("- \"--analysis\"\n        - \"{{Param.AnalysisFolder}}\"\n"));
        assert!(template.contains("- name: AnalysisFolder\n  type: PATH\n  description: \"Folder of the recording's analysis\"\n  objectType: DIRECTORY\n  dataFlow: OUT\n"));
        let slurm = file(&job, "slurm.sh");
        assert!(slurm.contains("after=(\"--dependency=afterok:${analysis%%;*}\")"), "{slurm}");
        // An empty array is an error under `set -u` in bash before 4.4.
        assert!(slurm.contains(" ${after[@]+\"${after[@]}\"} "), "{slurm}");
        let without = file(&self::job(), "template.yaml");
        assert!(!without.contains("Analyse") && without.contains("\"--no-analysis\""));
    }

    #[test]
    fn shell_commands_quote_paths_and_measured_cost_limits_time() {
        let job = FarmJob { cost: Some(PartCost { startup_s: 10.0, frame_s: 5.0 }), ..job() };
        let slurm = file(&job, "slurm.sh");
        assert!(slurm.contains(r"--scene '/s/it'\''s' --no-analysis"), "{slurm}");
        // 4 · (10 + 18 · 5) s and 600 s are 1000 s.
        assert!(slurm.contains("--time=17 "), "{slurm}");
        let readme = file(&job, "README.txt");
        assert!(readme.contains("parallel -q --jobs 1 --retries 3 locard farm part --frames {} --into /j/parts-4"));
        assert!(readme.contains("about 100 s for the longest part"), "{readme}");
    }

    #[test]
    fn video_parts_take_the_sound_from_the_recording_at_the_join() {
        let job = FarmJob {
            extension: Some("mkv".to_owned()),
            out: "/o.mkv".into(),
            options: vec!["--no-sound".to_owned(), "--skip-missing".to_owned()],
            ..job()
        };
        let template = file(&job, "template.yaml");
        assert!(template.contains("- \"--video\"\n        - \"mkv\"\n"));
        assert!(
            template.ends_with(
                "- \"--recording\"\n        - \"{{Param.RecordingFolder}}\"\n        - \"--skip-missing\"\n"
            ),
            "{template}"
        );
        assert_eq!(
            file(&job, "parameters.yaml").lines().find(|line| line.starts_with("Output")),
            Some("Output: \"/o.mkv\"")
        );
    }

    #[test]
    fn option_that_a_template_would_evaluate_is_refused() {
        let job = FarmJob { options: vec!["{{Param.Output}}".to_owned()], ..job() };
        assert!(job.files().unwrap_err().to_string().contains("cannot be in a job template"));
    }

    #[test]
    fn adapter_of_an_unlisted_kind_is_refused() {
        let job = FarmJob { adapter_kind: Some("discrete".to_owned()), ..job() };
        let error = job.files().unwrap_err().to_string();
        assert!(error.contains("discrete is no kind of adapter; expected one of Cpu, IntegratedGpu"), "{error}");
    }
}
