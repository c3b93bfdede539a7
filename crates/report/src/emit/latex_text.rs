//! Text for LaTeX.

use std::collections::BTreeSet;

/// Characters between U+00A0 and U+017F that pdfLaTeX cannot print in its default encoding, OT1.
const NOT_IN_OT1: &str = "«»ÐÞðþĄąĐđĘęĦħĮįĸĿŀŉŊŋŦŧŲųſ";

/// Escapes all of LaTeX's special characters, and writes others that pdfLaTeX would stop at by their commands. The hyphen before
/// a negative number becomes a minus.
pub(super) fn escaped(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    let mut before = None;
    let mut letters = text.chars().peekable();
    while let Some(letter) = letters.next() {
        match letter {
            '-' if is_sign(before, letters.peek().copied()) => safe.push_str("$-$"),
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => {
                safe.push('\\');
                safe.push(letter);
            }
            '-' | '–' | '—' => {
                // Hyphens would join to a longer dash.
                if safe.ends_with('-') {
                    safe.push_str("{}");
                }
                safe.push_str(match letter {
                    '–' => "--",
                    '—' => "---",
                    _ => "-",
                });
            }
            letter if letter.is_control() => safe.push(' '),
            letter => match (text_command(letter), formula(letter)) {
                (Some(command), _) => safe.push_str(command),
                (None, Some(formula)) => safe.push_str(&format!("${formula}$")),
                (None, None) => safe.push(letter),
            },
        }
        before = Some(letter);
    }
    safe
}

/// Whether a hyphen between these letters is the sign of a number.
fn is_sign(before: Option<char>, after: Option<char>) -> bool {
    before.is_none_or(|letter| matches!(letter, ' ' | '[' | '(')) && after.is_some_and(|letter| letter.is_ascii_digit())
}

/// Characters that pdfLaTeX stops at, each once with its code; `None` if there are none.
pub(super) fn beyond_pdflatex(text: &str) -> Option<String> {
    let is_known = |letter: char| ('\u{a0}'..='\u{17f}').contains(&letter) && !NOT_IN_OT1.contains(letter);
    let others: BTreeSet<char> = text.chars().filter(|letter| !letter.is_ascii() && !is_known(*letter)).collect();
    let listed: Vec<String> = others.iter().map(|letter| format!("{letter} (U+{:04X})", u32::from(*letter))).collect();
    (!listed.is_empty()).then(|| listed.join(", "))
}

/// What prints a character in text.
const fn text_command(letter: char) -> Option<&'static str> {
    Some(match letter {
        '\\' => "\\textbackslash{}",
        '~' => "\\textasciitilde{}",
        '^' => "\\textasciicircum{}",
        '`' => "\\textasciigrave{}",
        '|' => "\\textbar{}",
        '§' => "\\S{}",
        '…' => "\\dots{}",
        '•' => "\\textbullet{}",
        '‘' => "`",
        '’' => "'",
        '“' => "``",
        '”' => "''",
        '\u{2009}' | '\u{202f}' => "\\,",
        _ => return None,
    })
}

/// What prints a character in a formula.
const fn formula(letter: char) -> Option<&'static str> {
    Some(match letter {
        '<' => "<",
        '>' => ">",
        '−' => "-",
        '×' => "\\times",
        '·' | '\u{22c5}' => "\\cdot",
        '÷' => "\\div",
        '±' => "\\pm",
        '∓' => "\\mp",
        '≤' => "\\le",
        '≥' => "\\ge",
        '≪' => "\\ll",
        '≫' => "\\gg",
        '≠' => "\\ne",
        '≈' => "\\approx",
        '∼' => "\\sim",
        '≡' => "\\equiv",
        '∝' => "\\propto",
        '∞' => "\\infty",
        '∂' => "\\partial",
        '∇' => "\\nabla",
        '∑' => "\\sum",
        '∏' => "\\prod",
        '∈' => "\\in",
        '√' => "\\surd",
        '∘' => "\\circ",
        '°' => "^\\circ",
        '¹' => "^1",
        '²' => "^2",
        '³' => "^3",
        '←' => "\\leftarrow",
        '→' => "\\rightarrow",
        '↔' => "\\leftrightarrow",
        '↑' => "\\uparrow",
        '↓' => "\\downarrow",
        '⇒' => "\\Rightarrow",
        '†' => "^\\dagger",
        '‡' => "^\\ddagger",
        letter => return greek(letter),
    })
}

/// Greek letters that differ from Latin ones.
const fn greek(letter: char) -> Option<&'static str> {
    Some(match letter {
        'α' => "\\alpha",
        'β' => "\\beta",
        'γ' => "\\gamma",
        'δ' => "\\delta",
        'ε' => "\\varepsilon",
        'ϵ' => "\\epsilon",
        'ζ' => "\\zeta",
        'η' => "\\eta",
        'θ' => "\\theta",
        'ϑ' => "\\vartheta",
        'ι' => "\\iota",
        'κ' => "\\kappa",
        'λ' => "\\lambda",
        'μ' | '\u{b5}' => "\\mu",
        'ν' => "\\nu",
        'ξ' => "\\xi",
        'π' => "\\pi",
        'ρ' => "\\rho",
        'σ' => "\\sigma",
        'ς' => "\\varsigma",
        'τ' => "\\tau",
        'υ' => "\\upsilon",
        'φ' => "\\varphi",
        'ϕ' => "\\phi",
        'χ' => "\\chi",
        'ψ' => "\\psi",
        'ω' => "\\omega",
        'Γ' => "\\Gamma",
        'Δ' | '\u{2206}' => "\\Delta",
        'Θ' => "\\Theta",
        'Λ' => "\\Lambda",
        'Ξ' => "\\Xi",
        'Π' => "\\Pi",
        'Σ' => "\\Sigma",
        'Υ' => "\\Upsilon",
        'Φ' => "\\Phi",
        'Ψ' => "\\Psi",
        'Ω' | '\u{2126}' => "\\Omega",
        _ => return None,
    })
}
