//! Methods that are shell scripts, and images for them to answer with.

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use atsplat_eval::method::{Exec, ExecSettings, Method, Splatting, Warp};
use atsplat_eval::runner::KeepImages;

use super::{Run, Walls, dataset, entry};

/// A shell script that answers each trial with `body`, which sees `$trial`, `$folder` and `$scene`.
pub(crate) fn script(here: &Path, gives: &str, body: &str) -> String {
    let path = here.join("method.sh");
    let hello = format!(r#"{{"atsplat": 1, "name": "shell", "version": "1", "gives": "{gives}"}}"#);
    let text = format!(
        r#"cd '{}'
echo '{hello}'
field() {{ printf '%s' "$line" | sed "s/.*\"$1\":\"*\([^\",]*\).*/\1/"; }}
answer() {{ echo "{{\"trial\": $trial, $1}}"; }}
while IFS= read -r line; do
  trial=$(field trial) folder=$(field folder) scene=$(field scene)
  {body}
done
"#,
        here.display()
    );
    fs::write(&path, text).unwrap();
    format!("sh '{}'", path.display())
}

pub(crate) fn settings(command: &str) -> ExecSettings {
    ExecSettings {
        command: command.to_owned(),
        name: None,
        limit: Duration::from_mins(1),
        processes: 1,
        opacities_as_stored: false,
        splatting: Splatting::default(),
    }
}

pub(crate) fn exec(command: &str) -> Arc<dyn Method> {
    Arc::new(Exec::start(settings(command)).unwrap())
}

/// Targets 1 and 3 between the context views 0 and 4.
pub(crate) fn run_of(scenes: usize, method: Arc<dyn Method>) -> Run {
    Run::new(vec![dataset(Walls::new(scenes, 8), &[entry(&[0, 4], &[1, 3])])], vec![method])
}

/// Images of the warp below `here/warp`.
pub(crate) fn write_images(here: &Path, scenes: usize) {
    let run = Run { images: KeepImages::All, ..run_of(scenes, Arc::new(Warp)) };
    run.run(&here.join("store")).unwrap();
    fs::rename(here.join("store/images/walls/warp"), here.join("warp")).unwrap();
}
