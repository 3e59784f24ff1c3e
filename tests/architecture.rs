//! Checks the code against ARCHITECTURE.md and src/engine.rs. One file, because the checks share
//! the scan of the sources.
//!
//! The parser of imports guards the layers inside the one engine crate, where the compiler accepts
//! any import. Crates in its place would cost more than they save: CONTRIBUTING.md, "Size of the
//! code, and its crates", has the figures.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Every Rust file below a folder.
fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display())) {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                files.push(path);
            }
        }
    }
    files.sort();
    assert!(!files.is_empty(), "no Rust file below {}", folder.display());
    files
}

/// The lines of a file without comment lines, numbered from 1.
fn code(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines().enumerate().map(|(i, l)| (i + 1, l)).filter(|(_, l)| !l.trim_start().starts_with("//"))
}

fn is_word(c: char) -> bool {
    c.is_ascii_alphanumeric() || c == '_'
}

/// Each module of src/engine.rs with its dependency layer, the number of the comment `// N: ...`
/// above it.
fn layers() -> BTreeMap<String, u32> {
    let text = read(&root().join("src/engine.rs"));
    let mut layer = None;
    let mut modules = BTreeMap::new();
    for line in text.lines() {
        if let Some(number) = line.strip_prefix("// ").and_then(|l| l.split_once(':')).and_then(|(n, _)| n.parse().ok())
        {
            layer = Some(number);
        }
        if let Some(module) = line.strip_prefix("pub mod ").and_then(|l| l.strip_suffix(';')) {
            let layer =
                layer.unwrap_or_else(|| panic!("src/engine.rs: {module} has no layer above it, as `// 3: the scene`"));
            modules.insert(module.to_owned(), layer);
        }
    }
    assert!(modules.len() > 10, "src/engine.rs: found only {modules:?}");
    modules
}

/// Folders of the other crates. Their manifests keep the engine from using them.
const OTHER_CRATES: [&str; 2] = ["cli", "window"];

/// The engine's module of a file below src/; `None` for the crates' root files and for other
/// crates.
fn module_of(file: &Path) -> Option<String> {
    let first = file.strip_prefix(root().join("src")).unwrap().components().next().unwrap();
    let name = Path::new(first.as_os_str()).file_stem().unwrap().to_str().unwrap().to_owned();
    let is_own_file = ["build", "engine", "lib", "main"].contains(&name.as_str());
    (!is_own_file && !OTHER_CRATES.contains(&name.as_str())).then_some(name)
}

fn crate_paths(text: &str) -> Vec<(usize, String)> {
    paths_after("crate::", text)
}

/// The names after each occurrence of a prefix such as `crate::` in a file: (line, name). A group
/// `crate::{a, b}` yields each of its names.
fn paths_after(prefix: &str, text: &str) -> Vec<(usize, String)> {
    // Comments are blanked; line numbers do not change.
    let bare: String = text
        .lines()
        .map(|l| if l.trim_start().starts_with("//") { "\n".to_owned() } else { format!("{l}\n") })
        .collect();
    let mut names_of_lines = Vec::new();
    for (at, matched) in bare.match_indices(prefix) {
        if bare[..at].ends_with(is_word) || bare[..at].ends_with(['$', ':']) {
            continue;
        }
        let line = 1 + bare[..at].matches('\n').count();
        let rest = &bare[at + matched.len()..];
        let Some(group) = rest.strip_prefix('{') else {
            names_of_lines.push((line, rest.chars().take_while(|&c| is_word(c)).collect()));
            continue;
        };
        let (mut depth, mut name) = (0, String::new());
        let mut names = Vec::new();
        for c in group.chars() {
            match c {
                '{' => depth += 1,
                '}' if depth == 0 => break,
                '}' => depth -= 1,
                ',' if depth == 0 => names.push(std::mem::take(&mut name)),
                _ if depth == 0 => name.push(c),
                _ => {}
            }
        }
        names.push(name);
        for name in names {
            let name: String = name.trim().chars().take_while(|&c| is_word(c)).collect();
            if !name.is_empty() {
                names_of_lines.push((line, name));
            }
        }
    }
    names_of_lines
}

#[test]
fn paths_are_found_in_every_form() {
    let text =
        "// use crate::cli;\nuse crate::a::{self, b};\nuse crate::{c::{d, e}, f};\nlet x = crate::g::h(); $crate::i!()";
    let paths = crate_paths(text);
    let names: Vec<_> = paths.iter().map(|(line, name)| (*line, name.as_str())).collect();
    assert_eq!(names, [(2, "a"), (3, "c"), (3, "f"), (4, "g")]);
}

#[test]
fn module_uses_only_modules_of_its_layer_or_below() {
    let layers = layers();
    // Macros of src/params/declare.rs and src/gpu/uniform.rs are exported at the crate's root.
    let macros = ["params", "choices", "uniform"];
    let mut wrong = Vec::new();
    for file in rust_files(&root().join("src")) {
        let Some(module) = module_of(&file) else { continue };
        let shown = file.strip_prefix(root()).unwrap().display();
        let own = *layers.get(&module).unwrap_or_else(|| panic!("{shown}: src/engine.rs has no module {module}"));
        for (line, used) in crate_paths(&read(&file)) {
            match layers.get(&used) {
                Some(&layer) if layer > own => {
                    wrong.push(format!("{shown}:{line}: {module} (layer {own}) uses {used} (layer {layer})"));
                }
                None if !macros.contains(&used.as_str()) => {
                    wrong.push(format!("{shown}:{line}: {used} is no module of src/engine.rs"));
                }
                _ => {}
            }
        }
    }
    assert!(wrong.is_empty(), "a module uses only modules of its layer or below:\n{}", wrong.join("\n"));
}

/// Folders whose own file both declares types shared by its submodules and calls the submodules.
/// The list only shrinks.
const FOLDERS_WITH_CYCLES: [&str; 7] = ["bench", "camera/lens_map", "cli", "recording", "scene", "simulate", "sink"];

/// The text of a file before its unit tests, which may import anything.
fn without_tests(text: &str) -> &str {
    text.split("#[cfg(test)]\nmod tests").next().unwrap()
}

/// The names that a file declares itself.
fn declared(text: &str) -> BTreeSet<String> {
    const KINDS: [&str; 8] = ["struct ", "enum ", "trait ", "type ", "fn ", "const ", "static ", "union "];
    let mut names = BTreeSet::new();
    for (_, line) in code(without_tests(text)) {
        // Public methods are taken for items too; no path leads to one from `super`.
        let item = line.trim_start().strip_prefix("pub ").or_else(|| line.trim_start().strip_prefix("pub(super) "));
        let Some(item) = item.or_else(|| (!line.starts_with(' ')).then_some(line)) else { continue };
        let name = KINDS.iter().find_map(|kind| item.strip_prefix(kind));
        names.extend(name.map(|name| name.chars().take_while(|&c| is_word(c)).collect::<String>()));
    }
    names
}

/// A file's `use` declarations: whether it re-exports the names, and the path with its names,
/// without spaces.
fn uses(text: &str) -> Vec<(bool, String)> {
    let bare: Vec<&str> = code(without_tests(text)).map(|(_, line)| line).collect();
    let bare = format!("\n{}", bare.join("\n"));
    let of = |begin: &str, is_public: bool| {
        let path = |(at, _): (usize, &str)| bare[at + begin.len()..].split(';').next().unwrap().to_owned();
        let whole = |path: String| (is_public, path.chars().filter(|c| !c.is_whitespace()).collect());
        bare.match_indices(begin).map(path).map(whole).collect::<Vec<_>>()
    };
    [of("\nuse ", false), of("\npub use ", true), of("\npub(super) use ", true)].concat()
}

/// The file of a folder's module: its `mod.rs`, a crate's `lib.rs`, or the file of its name beside
/// it.
fn file_of(folder: &Path) -> PathBuf {
    let inside = MODULE_FILE_NAMES.map(|name| folder.join(name).with_extension("rs"));
    inside.into_iter().find(|file| file.is_file()).unwrap_or_else(|| folder.with_extension("rs"))
}

/// Possible names of a folder's own file. The import graph uses the first.
const MODULE_FILE_NAMES: [&str; 2] = ["mod", "lib"];

/// Import graph of a folder: its submodules and its own file, each with the ones that it imports. A
/// name that the folder's own file re-exports belongs to the submodule that declares it. A
/// submodule that only adds methods to a type of the folder's own file does not import that file.
fn imports_beside(folder: &Path) -> BTreeMap<String, BTreeSet<String>> {
    let mut modules: BTreeMap<String, Vec<PathBuf>> = BTreeMap::new();
    for file in rust_files(folder) {
        let inside = file.strip_prefix(folder).unwrap();
        let name = Path::new(inside.components().next().unwrap().as_os_str()).file_stem().unwrap().to_str().unwrap();
        if !MODULE_FILE_NAMES.contains(&name) {
            modules.entry(name.to_owned()).or_default().push(file);
        }
    }
    let own = read(&file_of(folder));
    let own_text = without_tests(&own);
    let own_names = declared(own_text);
    let mut passed_on: BTreeMap<String, String> = BTreeMap::new();
    let mut of_own = BTreeSet::new();
    for (is_public, path) in uses(own_text) {
        let path = path.trim_start_matches("self::");
        let Some((module, names)) = path.split_once("::").filter(|(module, _)| modules.contains_key(*module)) else {
            continue;
        };
        for name in names.trim_matches(['{', '}']).split(',').filter(|name| !name.is_empty()) {
            let name = name.rsplit("::").next().unwrap();
            let body = code(own_text).filter(|(_, line)| !line.contains("use "));
            let is_used = || {
                let text: String = body.map(|(_, line)| format!("{line}\n")).collect();
                text.match_indices(name)
                    .any(|(at, _)| !text[..at].ends_with(is_word) && !text[at + name.len()..].starts_with(is_word))
            };
            if !is_public || is_used() {
                of_own.insert(module.to_owned());
            }
            if is_public {
                passed_on.insert(name.to_owned(), module.to_owned());
            }
        }
    }
    for (_, line) in code(own_text).filter(|(_, line)| !line.contains("use ")) {
        for name in modules.keys() {
            let prefix = format!("{name}::");
            let is_path = |(at, _): (usize, &str)| !line[..at].ends_with(is_word) && !line[..at].ends_with(':');
            if line.match_indices(&prefix).any(is_path) {
                of_own.insert(name.clone());
            }
        }
    }

    let imported = |name: &String, files: &Vec<PathBuf>| {
        let mut used_modules = BTreeSet::new();
        for file in files.iter().filter(|file| !file.ends_with("tests.rs")) {
            let text = read(file);
            let text = without_tests(&text);
            // A file in a subfolder needs one more `super::` to reach the folder.
            let depth = file.strip_prefix(folder).unwrap().components().count();
            let is_own_mod = depth > 1 && file.file_name().is_some_and(|name| name == "mod.rs");
            let up = "super::".repeat(if is_own_mod { depth - 1 } else { depth });
            for (_, used) in paths_after(&up, text) {
                let is_extended = || code(text).any(|(_, line)| line.starts_with(&format!("impl {used} ")));
                if modules.contains_key(&used) {
                    used_modules.insert(used);
                } else if let Some(module) = passed_on.get(&used) {
                    used_modules.insert(module.clone());
                } else if own_names.contains(&used) && !is_extended() {
                    used_modules.insert(MODULE_FILE_NAMES[0].to_owned());
                }
            }
        }
        used_modules.remove(name);
        used_modules
    };
    let mut all: BTreeMap<_, _> = modules.iter().map(|(name, files)| (name.clone(), imported(name, files))).collect();
    all.insert(MODULE_FILE_NAMES[0].to_owned(), of_own);
    all
}

/// The files that a file of an import graph imports, directly or through others.
fn reachable<'a>(imports: &'a BTreeMap<String, BTreeSet<String>>, file: &str) -> BTreeSet<&'a str> {
    let mut files = BTreeSet::new();
    let mut queue: Vec<&str> = imports[file].iter().map(String::as_str).collect();
    while let Some(file) = queue.pop() {
        if files.insert(file) {
            queue.extend(imports[file].iter().map(String::as_str));
        }
    }
    files
}

/// All imports of an import graph that are part of a cycle: the imported file imports the importing
/// one, directly or through others.
fn circular_imports(imports: &BTreeMap<String, BTreeSet<String>>) -> Vec<(&str, &str)> {
    let all = imports.iter().flat_map(|(file, used)| used.iter().map(move |used| (file.as_str(), used.as_str())));
    all.filter(|(file, used)| reachable(imports, used).contains(file)).collect()
}

#[test]
fn imports_of_every_cycle_are_found() {
    let graph = |text: &str| -> BTreeMap<String, BTreeSet<String>> {
        let pair = |line: &str| {
            let (file, used) = line.split_once('>').unwrap();
            (file.to_owned(), used.chars().map(String::from).collect())
        };
        text.split(' ').map(pair).collect()
    };
    assert_eq!(circular_imports(&graph("a>bc b>c c>d d>")), []);
    assert_eq!(circular_imports(&graph("a>b b>c c>d d>b")), [("b", "c"), ("c", "d"), ("d", "b")]);
    let two = graph("a>b b>a c>d d>c e>ac");
    assert_eq!(circular_imports(&two), [("a", "b"), ("b", "a"), ("c", "d"), ("d", "c")]);
}

#[test]
fn declarations_and_reexports_of_a_file_are_found() {
    let text = "//! use a::B;\nuse crate::x::Y;\npub use kept::{\n    One,\n    Two,\n};\nuse kept::few;\npub struct Own;\n\
                crate::params! {\n    pub struct Table in \"t\" {\n}\n}\nimpl Own {\n    fn inner() {}\n}\nconst N: u8 = 1;\n\
                #[cfg(test)]\nmod tests {\n    use kept::other;\n    pub struct Test;\n}\n";
    let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<BTreeSet<_>>();
    assert_eq!(declared(text), names(&["N", "Own", "Table"]));
    let declarations = uses(text);
    let paths: Vec<_> = declarations.iter().map(|(is_public, path)| (*is_public, path.as_str())).collect();
    assert_eq!(paths, [(false, "crate::x::Y"), (false, "kept::few"), (true, "kept::{One,Two,}")]);
}

#[test]
fn files_of_a_module_have_no_circular_imports() {
    let mut wrong = Vec::new();
    let mut mended: BTreeSet<&str> = FOLDERS_WITH_CYCLES.into();
    let mut folders = vec![root().join("src")];
    while let Some(folder) = folders.pop() {
        let inner = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path());
        folders.extend(inner.filter(|path| path.is_dir()));
        // The modules at the top have layers instead.
        if folder == root().join("src") {
            continue;
        }
        let name = folder.strip_prefix(root().join("src")).unwrap().display().to_string();
        let mut imports = imports_beside(&folder);
        if mended.contains(name.as_str()) {
            if !circular_imports(&imports).is_empty() {
                mended.remove(name.as_str());
            }
            imports.insert(MODULE_FILE_NAMES[0].to_owned(), BTreeSet::new());
        }
        let circular = circular_imports(&imports);
        wrong.extend(circular.into_iter().map(|(file, used)| format!("src/{name}: {file} imports {used}")));
    }
    assert!(wrong.is_empty(), "circular imports between files of a module:\n{}", wrong.join("\n"));
    assert!(mended.is_empty(), "no longer circular, so remove them from FOLDERS_WITH_CYCLES: {mended:?}");
}

#[test]
fn command_line_names_no_effect() {
    let effects: Vec<String> = locard::effects::all().iter().map(|e| e.table().to_owned()).collect();
    assert!(effects.contains(&"motion_blur".to_owned()));
    let mut wrong = Vec::new();
    for file in rust_files(&root().join("src/cli")) {
        for (line, text) in code(&read(&file)) {
            // A camera's measured noise is a table of the camera, not of an effect.
            let of_camera = text.contains("camera.");
            let named = effects.iter().any(|effect| {
                (effect.contains('_') && text.contains(effect.as_str()))
                    || text.contains(&format!("\"{effect}."))
                    || (text.contains(&format!("\"{effect}\"")) && !of_camera)
            });
            if named || text.contains("effects::") {
                wrong.push(format!("{}:{line}: {}", file.display(), text.trim()));
            }
        }
    }
    assert!(wrong.is_empty(), "the command line takes effects from their list:\n{}", wrong.join("\n"));
}

#[test]
fn camera_uses_no_gpu_and_no_files() {
    for file in rust_files(&root().join("src/camera")) {
        for (line, text) in code(&read(&file)) {
            for word in ["wgpu", "std::fs", "std::io", "std::path", "File::"] {
                assert!(!text.contains(word), "{}:{line}: the camera uses no GPU and no file: {word}", file.display());
            }
        }
    }
}

#[test]
fn effects_open_no_files_and_read_no_clock() {
    for file in rust_files(&root().join("src/effects")) {
        for (line, text) in code(&read(&file)) {
            for word in ["std::fs", "std::io", "std::env", "std::net", "Instant", "SystemTime"] {
                assert!(!text.contains(word), "{}:{line}: an effect reads only its frame: {word}", file.display());
            }
        }
    }
}

#[test]
fn architecture_md_lists_every_module_and_effect() {
    let page = read(&root().join("ARCHITECTURE.md"));
    for (module, _) in layers() {
        let (folder, file) = (root().join("src").join(&module), root().join(format!("src/{module}.rs")));
        let name = if folder.is_dir() { format!("`{module}/`") } else { format!("`{module}`") };
        assert!(folder.is_dir() || file.is_file(), "src/engine.rs: {module} has no file");
        assert!(page.contains(&name), "ARCHITECTURE.md does not mention {name}");
    }
    for entry in std::fs::read_dir(root().join("src")).unwrap() {
        let entry = entry.unwrap();
        let name = entry.file_name().into_string().unwrap();
        if entry.path().is_dir() {
            assert!(page.contains(&format!("`{name}/`")), "ARCHITECTURE.md does not mention `{name}/`");
        }
    }
    for effect in locard::effects::all() {
        let name = effect.table().to_owned();
        assert!(page.contains(&format!("`{name}`")), "ARCHITECTURE.md does not mention the effect `{name}`");
    }
}

#[test]
fn window_uses_the_system_clipboard() {
    let text = read(&root().join("Cargo.toml"));
    let dependency = text.lines().find(|line| line.starts_with("eframe = ")).unwrap();
    // Without it egui copies into a private string that no other program can read.
    assert!(dependency.contains("\"clipboard\""), "{dependency}");
}

/// Cells that are filled once, and their lazy forms.
const ONCE_CELLS: [&str; 4] = ["OnceLock<", "OnceCell<", "LazyLock<", "LazyCell<"];
/// Containers behind a lock or a cell, which a shared reference can fill.
const LOCKS: [&str; 3] = ["Mutex<", "RwLock<", "RefCell<"];
const LOCKED_CONTAINERS: [&str; 3] = ["HashMap<", "BTreeMap<", "Option<"];

/// State that is no derived data, by file and declaration: drivers that stay loaded, readbacks,
/// clocks, variables of the environment, running tasks, stamps of files, sequence numbers of
/// streams, picked regions.
const NOT_DERIVED: [(&str, &str); 17] = [
    ("analyse/light/voxels.rs", "index"),
    ("gpu/device.rs", "FIRST"),
    ("gpu/readback.rs", "mapped"),
    ("gpu/readback.rs", "MapReporter"),
    ("recording/depth.rs", "undecoded"),
    ("scene/gltf.rs", "chunk"),
    ("stream/assemble.rs", "evidence"),
    ("stream/assemble.rs", "previous"),
    ("stream/buffer.rs", "last"),
    ("webcam/clock.rs", "FIRST"),
    ("window/chooser.rs", "listing_task"),
    ("window/file_watch.rs", "recorded"),
    ("window/file_watch.rs", "changes"),
    ("window/project.rs", "stamps"),
    ("window/restart.rs", "AFTER_S"),
    ("window/scene_checks.rs", "pending"),
    ("window/tool.rs", "picked_region"),
];

/// The text after each access to a field of `self`, also across line breaks.
fn accesses<'a>(code: &'a str, field: &str) -> impl Iterator<Item = &'a str> {
    let name = format!(".{field}");
    let after_self = code.match_indices("self").map(|(at, word)| code[at + word.len()..].trim_start());
    after_self.filter_map(move |rest| rest.strip_prefix(&name).filter(|rest| !rest.starts_with(is_word)))
}

/// The name of a declaration that may be a cache, found by one of three patterns:
/// - a cell that is filled once (`OnceLock`, `LazyLock`);
/// - a map or an `Option` behind a lock or a `RefCell`, except of errors;
/// - a field that its own file fills and compares: an `Option<(key, value)>` that is assigned and
///   whose content is tested with `==` or `!=`, or a map with `insert` and `get`.
fn possible_cache(line: &str, code: &str) -> Option<String> {
    let line = line.trim_start();
    let mut words = line.split(|c| !is_word(c)).filter(|word| !word.is_empty());
    let name = words.find(|word| !["pub", "super", "crate", "static", "struct", "type", "let"].contains(word))?;
    let is_cell = ONCE_CELLS.iter().any(|cell| line.contains(cell));
    let is_locked = LOCKS.iter().any(|lock| {
        let inner = line.split(*lock).nth(1).unwrap_or_default().trim_start_matches("std::collections::");
        let first_type = |container: &&str| inner.strip_prefix(*container).and_then(|inside| inside.split('>').next());
        LOCKED_CONTAINERS.iter().find_map(first_type).is_some_and(|inside| !inside.ends_with("Error"))
    });
    let is_keyed = line.split_once(&format!("{name}: ")).is_some_and(|(_, ty)| {
        let calls = |method: &str| accesses(code, name).any(|rest| rest.trim_start().starts_with(method));
        let is_compared = |rest: &str| {
            let nearby: String = rest.chars().take(100).collect();
            nearby.contains("==") || nearby.contains("!=")
        };
        let is_pair = ty.starts_with("Option<(") && calls("= Some(") && accesses(code, name).any(is_compared);
        let is_map = ty.starts_with("HashMap<") || ty.starts_with("BTreeMap<");
        is_pair || (is_map && calls(".insert(") && calls(".get("))
    });
    (is_cell || is_locked || is_keyed).then(|| name.to_owned())
}

#[test]
fn caches_of_every_form_are_found() {
    let pair = "    last: Option<(Key, Value)>,";
    let map = "    pub by_key: HashMap<Key, Value>,";
    let compares = "if self.last.as_ref().is_some_and(|(k, _)| *k == key) {}\nself.last = Some((key, value));";
    let looks_up = "self.by_key.get(&key);\nself\n    .by_key\n    .insert(key, value);";
    let cache = |line: &str, code: &str| possible_cache(line, code);
    for line in ["    rays: OnceLock<Vec<f32>>,", "static rays: LazyLock<Vec<f32>> = LazyLock::new(|| {"] {
        assert_eq!(cache(line, "").as_deref(), Some("rays"), "{line}");
    }
    for line in
        ["    all: Mutex<HashMap<Key, Value>>,", "    all: Arc<RwLock<std::collections::BTreeMap<Key, Value>>>,"]
    {
        assert_eq!(cache(line, "").as_deref(), Some("all"), "{line}");
    }
    assert_eq!(cache(pair, compares).as_deref(), Some("last"));
    assert_eq!(cache(map, looks_up).as_deref(), Some("by_key"));
    assert_eq!(cache(pair, "self.last = Some((key, value));"), None);
    assert_eq!(cache(pair, &compares.replace("self.last", "self.last_one")), None);
    assert_eq!(cache(map, "self.by_key.insert(key, value);"), None);
    assert_eq!(cache("    failure: Mutex<Option<GpuError>>,", ""), None);
    assert_eq!(cache("    size_px: [u32; 2],", ""), None);
}

#[test]
fn derived_data_outside_a_memo_has_a_reason() {
    let folder = root().join("src");
    let mut explained = 0;
    let mut not_derived: BTreeSet<(&str, &str)> = NOT_DERIVED.into();
    let mut wrong = Vec::new();
    for path in rust_files(&folder).iter().filter(|path| !path.ends_with("tests.rs") && !path.ends_with("memo.rs")) {
        let name = path.strip_prefix(&folder).unwrap().to_string_lossy().replace('\\', "/");
        let text = read(path);
        let text = without_tests(&text);
        let lines: Vec<&str> = text.lines().collect();
        let bare: Vec<&str> = code(text).map(|(_, line)| line).collect();
        let bare = bare.join("\n");
        for (n, line) in code(text) {
            let Some(declared) = possible_cache(line, &bare) else { continue };
            let comment = lines[..n - 1].iter().rev().take_while(|line| line.trim_start().starts_with(['/', '#']));
            // A sentence may continue on the next line.
            let comment: Vec<&str> = comment.map(|line| line.trim_start().trim_start_matches('/').trim()).collect();
            let is_explained = comment.into_iter().rev().collect::<Vec<_>>().join(" ").contains("No memo: ");
            explained += usize::from(is_explained);
            let is_state = NOT_DERIVED.contains(&(name.as_str(), declared.as_str()));
            not_derived.retain(|place| *place != (name.as_str(), declared.as_str()));
            if !is_explained && !is_state {
                wrong.push(format!("{name}:{n}: {declared}"));
            }
        }
    }
    assert!(wrong.is_empty(), "no memo, and no reason after `No memo: `:\n{}", wrong.join("\n"));
    assert!(not_derived.is_empty(), "remove from NOT_DERIVED: {not_derived:?}");
    assert!(explained > 20, "{explained}");
}
