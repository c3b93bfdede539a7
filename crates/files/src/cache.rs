use std::env;
use std::ffi::OsString;
use std::path::PathBuf;

/// `atsplat` in the user's folder for caches: `%LOCALAPPDATA%` on Windows, `~/Library/Caches` on macOS, else `$XDG_CACHE_HOME` or
/// `~/.cache`. `None` if the environment does not name one by an absolute path.
pub fn cache_folder() -> Option<PathBuf> {
    folder(env::consts::OS, &|name| env::var_os(name))
}

fn folder(system: &str, variable: &dyn Fn(&str) -> Option<OsString>) -> Option<PathBuf> {
    let path = |name| variable(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let caches = match system {
        "windows" => path("LOCALAPPDATA"),
        "macos" => path("HOME").map(|home| home.join("Library/Caches")),
        _ => path("XDG_CACHE_HOME").or_else(|| path("HOME").map(|home| home.join(".cache"))),
    };
    Some(caches?.join("atsplat"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_folder_follows_the_system_and_its_environment() {
        // Absolute on the system that runs this test.
        let root = env::temp_dir();
        let of = |system: &str, set: &[&str]| {
            let variable = |name: &str| set.contains(&name).then(|| root.join(name).into_os_string());
            folder(system, &variable).map(|path| path.strip_prefix(&root).unwrap().to_owned())
        };
        let all = ["HOME", "XDG_CACHE_HOME", "LOCALAPPDATA"];
        assert_eq!(of("linux", &all), Some("XDG_CACHE_HOME/atsplat".into()));
        assert_eq!(of("linux", &["HOME", "LOCALAPPDATA"]), Some("HOME/.cache/atsplat".into()));
        assert_eq!(of("macos", &all), Some("HOME/Library/Caches/atsplat".into()));
        assert_eq!(of("windows", &all), Some("LOCALAPPDATA/atsplat".into()));
        assert_eq!((of("linux", &[]), of("windows", &["HOME"])), (None, None));
        let empty = |name: &str| Some(if name == "HOME" { root.clone().into_os_string() } else { OsString::new() });
        assert_eq!(folder("linux", &empty), Some(root.join(".cache/atsplat")));
    }
}
