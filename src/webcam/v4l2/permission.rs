//! Advice for a device that may not be opened.

use std::path::Path;

/// Who may open a device, by its group. Linux only.
pub fn advice(path: &Path) -> String {
    use std::os::unix::fs::MetadataExt;
    let gid = std::fs::metadata(path).map(|metadata| metadata.gid()).ok();
    let groups = std::fs::read_to_string("/etc/group").unwrap_or_default();
    let named = |line: &str| {
        let mut parts = line.split(':');
        let name = parts.next()?.to_owned();
        (parts.nth(1)?.parse().ok() == gid).then_some(name).filter(|_| gid.is_some())
    };
    // Nobody should be of root's group for a camera.
    match groups.lines().find_map(named).filter(|_| gid != Some(0)) {
        Some(group) => {
            format!("you are not in the group {group}, which may; `sudo usermod -aG {group} $USER`, then log in again")
        }
        None => "only root may; an administrator can give it to the group video".to_owned(),
    }
}
