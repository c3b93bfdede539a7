use std::fs;

use super::CpuRenderer;
use crate::Renderer as _;

/// The type of this machine's processor, on which the last bits of results may depend: its name, family and model, if known, and
/// the instruction set that renders.
pub fn processor() -> String {
    // Systems other than Linux have no such file.
    let cpuinfo = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    format!("{}, {}", described(&cpuinfo), CpuRenderer::default().name())
}

/// What the first processor of `/proc/cpuinfo` is called. Virtual machines shorten names, so that "AMD EPYC" may be of any
/// generation: family and model tell generations apart. ARM has an implementer and a part instead.
fn described(cpuinfo: &str) -> String {
    let field = |name: &str| {
        let fields = cpuinfo.lines().filter_map(|line| line.split_once(':'));
        fields.map(|(key, value)| (key.trim(), value.trim())).find(|&(key, _)| key == name).map(|(_, value)| value)
    };
    let name = field("model name").unwrap_or("unknown processor");
    match (field("cpu family"), field("model"), field("CPU implementer"), field("CPU part")) {
        (Some(family), Some(model), ..) => format!("{name} (family {family}, model {model})"),
        (.., Some(implementer), Some(part)) => format!("{name} (implementer {implementer}, part {part})"),
        _ => name.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::described;

    #[test]
    fn family_and_model_distinguish_processors_of_one_name() {
        let epyc = |family: u32, model: u32| {
            format!(
                "processor\t: 0\nvendor_id\t: AuthenticAMD\ncpu family\t: {family}\nmodel\t\t: {model}\nmodel name\t: AMD EPYC\n"
            )
        };
        assert_eq!(described(&epyc(25, 17)), "AMD EPYC (family 25, model 17)");
        assert_eq!(described(&epyc(26, 2)), "AMD EPYC (family 26, model 2)");
    }

    #[test]
    fn arm_has_implementer_and_part() {
        let graviton = "processor\t: 0\nCPU implementer\t: 0x41\nCPU architecture: 8\nCPU part\t: 0xd40\n";
        assert_eq!(described(graviton), "unknown processor (implementer 0x41, part 0xd40)");
    }

    #[test]
    fn other_systems_say_that_the_processor_is_unknown() {
        assert_eq!(described(""), "unknown processor");
        assert_eq!(described("model name\t: Some CPU\n"), "Some CPU");
    }
}
