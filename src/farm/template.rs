//! A plan as files for job engines: an Open Job Description template, a Slurm script, and lines for
//! GNU parallel and Dask. Source: Open Job Description, *Template Schemas*, 2023-09.

use std::path::{Path, PathBuf};

use super::command::{PathParameter, Word, shell_line, shell_quoted};
use super::cost::PartCost;
use super::error::FarmError;
use super::ranges::FarmPlan;
use crate::text::quoted;

/// Kinds of adapters, as records name them.
pub const ADAPTER_KINDS: [&str; 5] = ["Cpu", "IntegratedGpu", "DiscreteGpu", "VirtualGpu", "Other"];
/// Longest name of a job, characters, in Open Job Description 2023-09.
const MAX_NAME_CHARS: usize = 128;
/// Longest part of a time limit for a task, as a multiple of the measured estimate.
const TIME_LIMIT_FACTOR: f64 = 4.0;
/// Part of a time limit that does not depend on the estimate, s.
const TIME_LIMIT_S: f64 = 600.0;

/// A recording to composite on many machines.
#[derive(Clone, Debug)]
pub struct FarmJob {
    pub name: String,
    pub plan: FarmPlan,
    /// The program on the machines: a name in their PATH, or a path.
    pub program: String,
    /// Identifier of the build that all machines must have, hexadecimal.
    pub build: String,
    /// Kind of adapter that all machines must have; `None`: any, but one for all parts.
    pub adapter_kind: Option<String>,
    /// Folder or file of the recording, absolute, like all paths here.
    pub recording: PathBuf,
    pub scene: PathBuf,
    pub profile: Option<PathBuf>,
    /// Folder of the recording's analysis. `None`: the recording is used as it was recorded.
    pub analysis: Option<PathBuf>,
    /// True if a task makes the analysis before all others.
    pub analyses: bool,
    /// Options of `locard analyse`.
    pub analysis_options: Vec<String>,
    /// Further options of `locard composite`.
    pub options: Vec<String>,
    /// Folder for the parts.
    pub parts_folder: PathBuf,
    /// Extension of the parts and of the output if they are videos.
    pub extension: Option<String>,
    /// True if a joined video gets the sound of the recording.
    pub sound: bool,
    pub out: PathBuf,
    /// Cost of a part on the machine that made the plan, if it was measured.
    pub cost: Option<PartCost>,
}

impl FarmJob {
    /// Refuses kinds of adapters that do not exist, and texts that templates would take for
    /// expressions.
    pub(super) fn check(&self) -> Result<(), FarmError> {
        if let Some(kind) = self.adapter_kind.as_deref().filter(|kind| !ADAPTER_KINDS.contains(kind)) {
            let kinds = ADAPTER_KINDS.join(", ");
            return Err(FarmError::Plan(format!("{} is no kind of adapter; expected one of {kinds}", quoted(kind))));
        }
        let parameters = self.parameters();
        let files = parameters.iter().filter_map(|parameter| parameter.file.as_ref());
        let texts = self.options.iter().chain(&self.analysis_options).chain([&self.program]).chain(files);
        match texts.into_iter().find(|text| text.contains("{{") || text.chars().any(char::is_control)) {
            Some(text) => Err(FarmError::Plan(format!(
                "{text:?} cannot be in a job template, which takes {{{{ for an expression; rename it"
            ))),
            None => Ok(()),
        }
    }

    /// Name of the job, as templates accept it.
    pub(super) fn template_name(&self) -> String {
        let name = format!("Locard {}", self.name.replace("{{", "_"));
        name.chars().filter(|c| !c.is_control()).take(MAX_NAME_CHARS).collect()
    }

    /// The ranges of frames of the parts, as in `40..50`.
    pub(super) fn ranges(&self) -> Vec<String> {
        self.plan.parts.iter().map(|part| format!("{}..{}", part.start, part.end)).collect()
    }

    /// The folders and files that tasks read and write.
    pub(super) fn parameters(&self) -> Vec<PathParameter> {
        let mut all = vec![
            self.recording(),
            self.scene(),
            output("PartsFolder", "Folder for the parts", &self.parts_folder, "DIRECTORY"),
            output(
                "Output",
                "The joined output",
                &self.out,
                if self.extension.is_some() { "FILE" } else { "DIRECTORY" },
            ),
        ];
        all.extend(self.profile_parameter());
        all.extend(self.analysis_parameter());
        all
    }

    fn recording(&self) -> PathParameter {
        input("RecordingFolder", "Folder of the recording, with everything that it names", &self.recording)
    }

    fn scene(&self) -> PathParameter {
        input("SceneFolder", "Folder of the scene, with the models that it names", &self.scene)
    }

    fn profile_parameter(&self) -> Option<PathParameter> {
        self.profile.as_deref().map(|profile| PathParameter {
            name: "Profile",
            description: "Profile of the camera",
            path: profile.to_owned(),
            file: None,
            object_type: "FILE",
            data_flow: "IN",
        })
    }

    fn analysis_parameter(&self) -> Option<PathParameter> {
        let analysis = self.analysis.as_deref()?;
        let parameter = output("AnalysisFolder", "Folder of the recording's analysis", analysis, "DIRECTORY");
        Some(PathParameter { data_flow: if self.analyses { "OUT" } else { "IN" }, ..parameter })
    }

    /// `locard farm check`, which fails if the machine has another program or kind of adapter.
    pub(super) fn check_command(&self) -> Vec<Word> {
        let mut words = texts(["farm", "check"]);
        words.extend(self.environment());
        words
    }

    fn environment(&self) -> Vec<Word> {
        let mut words = texts(["--build", &self.build]);
        words.extend(self.adapter_kind.iter().flat_map(|kind| texts(["--adapter-kind", kind])));
        words
    }

    /// `locard analyse`.
    pub(super) fn analyse_command(&self) -> Option<Vec<Word>> {
        let folder = self.analysis_parameter().filter(|_| self.analyses)?;
        let mut words = texts(["analyse"]);
        words.push(Word::Path(self.recording()));
        words.extend([Word::Text("-o".to_owned()), Word::Path(folder)]);
        words.extend(self.camera());
        words.extend([Word::Text("--scene".to_owned()), Word::Path(self.scene())]);
        words.extend(self.analysis_options.iter().cloned().map(Word::Text));
        Some(words)
    }

    fn camera(&self) -> Vec<Word> {
        let profile = self.profile_parameter().into_iter();
        profile.flat_map(|profile| [Word::Text("--profile".to_owned()), Word::Path(profile)]).collect()
    }

    /// `locard farm part`: composites one part unless it is there already.
    pub(super) fn part_command(&self) -> Vec<Word> {
        let mut words = texts(["farm", "part", "--frames"]);
        words.extend([Word::Frames, Word::Text("--into".to_owned())]);
        words.push(Word::Path(output("PartsFolder", "", &self.parts_folder, "DIRECTORY")));
        words.extend(self.extension.iter().flat_map(|extension| texts(["--video", extension])));
        words.extend(self.environment());
        words.push(Word::Text("--".to_owned()));
        words.push(Word::Path(self.recording()));
        words.extend([Word::Text("--scene".to_owned()), Word::Path(self.scene())]);
        words.extend(self.camera());
        match self.analysis_parameter() {
            Some(analysis) => words.extend([Word::Text("--analysis".to_owned()), Word::Path(analysis)]),
            None => words.extend(texts(["--no-analysis"])),
        }
        words.extend(self.options.iter().cloned().map(Word::Text));
        words
    }

    /// `locard join`. It replaces its own output after an interruption.
    pub(super) fn join_command(&self) -> Vec<Word> {
        let frames = format!("{}..{}", self.plan.frames.start, self.plan.frames.end);
        let mut words = texts(["join"]);
        words.push(Word::Path(output("PartsFolder", "", &self.parts_folder, "DIRECTORY")));
        words.extend([Word::Text("-o".to_owned()), Word::Path(output("Output", "", &self.out, "FILE"))]);
        words.extend(texts(["--frames", &frames, "--force"]));
        if self.extension.is_some() {
            words.extend([Word::Text("--recording".to_owned()), Word::Path(self.recording())]);
            if !self.sound {
                words.extend(texts(["--no-sound"]));
            }
            let skips = self.options.iter().filter(|option| option.starts_with("--skip-"));
            words.extend(skips.cloned().map(Word::Text));
        }
        words
    }

    /// A command line for a POSIX shell.
    fn shell(&self, words: &[Word], frames: &str) -> String {
        format!("{} {}", shell_quoted(&self.program), shell_line(words, frames))
    }

    /// Time limit of a task, minutes; `None` if no cost was measured.
    fn time_limit_min(&self) -> Option<u64> {
        let cost = self.cost?;
        Some(((TIME_LIMIT_FACTOR * cost.of_part_s(self.plan.longest()) + TIME_LIMIT_S) / 60.0).ceil() as u64)
    }

    /// A script that submits itself as an array of parts, and the steps before and after it.
    pub(super) fn slurm(&self) -> String {
        let ranges = self.ranges();
        let name = shell_quoted(&self.template_name());
        let limit = self.time_limit_min().map_or(String::new(), |minutes| format!(" --time={minutes}"));
        let mut text = format!(
            "#!/bin/bash\n# {}: {} parts on Slurm. `bash slurm.sh` submits it; again, it makes the missing parts.\n\
             # Options for all tasks: the variables SBATCH_… (man sbatch), as in SBATCH_PARTITION=gpu.\n\
             set -euo pipefail\nranges=({})\nif [ -n \"${{SLURM_ARRAY_TASK_ID:-}}\" ]; then\n    exec {}\nfi\n\
             after=()\n",
            self.template_name(),
            ranges.len(),
            ranges.join(" "),
            self.shell(&self.part_command(), "\"${ranges[$SLURM_ARRAY_TASK_ID]}\""),
        );
        if let Some(analyse) = self.analyse_command() {
            let wrapped = shell_quoted(&self.shell(&analyse, ""));
            text += &format!(
                "analysis=$(sbatch --parsable --requeue --job-name={name}-analysis --wrap={wrapped})\n\
                 after=(\"--dependency=afterok:${{analysis%%;*}}\")\n"
            );
        }
        let join = shell_quoted(&self.shell(&self.join_command(), ""));
        text += &format!(
            "parts=$(sbatch --parsable --requeue --job-name={name}{limit} --array=0-{} ${{after[@]+\"${{after[@]}}\"}} \"$0\")\n\
             sbatch --requeue --job-name={name}-join --dependency=\"afterok:${{parts%%;*}}\" --wrap={join}\n",
            ranges.len().saturating_sub(1),
        );
        text
    }

    pub(super) fn readme(&self) -> String {
        let part = self.shell(&self.part_command(), "{}");
        let analyse = self.analyse_command().map_or(String::new(), |words| format!("{} &&\n", self.shell(&words, "")));
        let join = self.shell(&self.join_command(), "");
        let longest = self.plan.longest();
        let cost = self.cost.map_or("The cost of a frame was not measured.".to_owned(), |cost| {
            let (startup_s, frame_s, part_s) = (cost.startup_s, cost.frame_s, cost.of_part_s(longest));
            format!(
                "Measured on the machine that wrote this: {startup_s:.1} s to start, {frame_s:.3} s a frame, so about \
                 {part_s:.0} s for the longest part."
            )
        });
        let Self { build, plan, .. } = self;
        let kind =
            self.adapter_kind.as_ref().map_or(String::new(), |kind| format!(" and an adapter of the kind {kind}"));
        let python = "import subprocess, sys; from dask.distributed import Client; command = sys.argv[2:]; \
                      run = lambda frames: subprocess.run([word.replace(\"{}\", frames) for word in command], check=True); \
                      client = Client(sys.argv[1]); \
                      client.gather(client.map(run, open(\"parts.txt\").read().split(), retries=3, pure=False))";
        format!(
            "{name}\n\nFrames {start}..{end} in {parts}. {cost}\n\n\
             All machines need the same build of the program ({program}, SHA-256 {build}){kind}, ffmpeg for videos, and the \
             paths below. Each task checks this. Parts that are there and complete are kept, so every command below can be \
             repeated after an interruption. Run them in this folder.\n\n\
             One machine, Open Job Description (pip install openjd-cli):\n\n\
             openjd run template.yaml -p file://parameters.yaml --step Join --run-dependencies\n\n\
             AWS Deadline Cloud (pip install deadline): the folder is a job bundle.\n\n\
             deadline bundle submit .\n\n\
             Slurm, with a shared file system:\n\n\
             bash slurm.sh\n\n\
             GNU parallel; --sshloginfile HOSTS spreads the parts over machines:\n\n\
             {analyse}parallel -q --jobs 1 --retries 3 {part} :::: parts.txt &&\n{join}\n\n\
             Dask (pip install distributed), with the address of its scheduler:\n\n\
             {analyse}python3 -c '{python}' tcp://SCHEDULER:8786 {quoted_part} &&\n{join}\n\n\
             One part alone, here the first:\n\n{first}\n",
            name = self.template_name(),
            start = plan.frames.start,
            end = plan.frames.end,
            parts = plan.summary(),
            program = self.program,
            quoted_part = self.shell(&self.part_command(), "'{}'"),
            first = self.shell(&self.part_command(), self.ranges().first().map_or("", String::as_str)),
        )
    }
}

fn texts<const N: usize>(words: [&str; N]) -> Vec<Word> {
    words.map(|word| Word::Text(word.to_owned())).to_vec()
}

/// A parameter for an input and the files beside it: a folder, or the folder of a file.
fn input(name: &'static str, description: &'static str, path: &Path) -> PathParameter {
    let (folder, file) = match (path.is_file(), path.parent(), path.file_name()) {
        (true, Some(folder), Some(file)) => (folder, Some(file.to_string_lossy().into_owned())),
        _ => (path, None),
    };
    PathParameter { name, description, path: folder.to_owned(), file, object_type: "DIRECTORY", data_flow: "IN" }
}

fn output(name: &'static str, description: &'static str, path: &Path, object_type: &'static str) -> PathParameter {
    PathParameter { name, description, path: path.to_owned(), file: None, object_type, data_flow: "OUT" }
}
