//! Terms of the field and of this program, explained under the pointer where they stand in a table's head or a caption.
//!
//! One sentence each; the page needs no other document for its first reading. A term is explained once in a piece of
//! text.

use super::escape;

/// Term, as it is written, and what it means.
pub const TERMS: [(&str, &str); 43] = [
    (
        "nats",
        "natural logarithm of how much more likely the record is with the finding than without it; 5 is a factor of \
         148",
    ),
    ("held-out", "measured but not used to fit anything: what the result is checked on"),
    ("held out", "measured but not used to fit anything: what the result is checked on"),
    ("declared", "with the machine as its owner described it, nothing adjusted"),
    ("calibrated", "with the numbers of the machine adjusted to the record, nothing added"),
    ("corrected", "with the findings of this page added"),
    (
        "noise floor",
        "what would stay where nothing but noise is left; an estimate, so that a result may lie some per cent below it",
    ),
    ("named", "one cause of the library explains it, and no other does"),
    ("ambiguous", "two causes explain it alike on this record"),
    ("generic", "lines that stand, without a cause that can be named"),
    ("searched", "channel on which findings were looked for; the others check them"),
    ("SER p/g", "sidebands over their mesh harmonic, at the pinion's and the gear's turns"),
    ("BPFO", "rate at which rolling elements pass a spot on the outer ring"),
    ("BPFI", "rate at which rolling elements pass a spot on the inner ring"),
    ("ball spin", "rate at which a rolling element turns about itself"),
    ("equivalent noise bandwidth", "width of the filter that a window's line is: noise in a bin grows with it"),
    ("crest", "peak over RMS: impacts raise it"),
    ("hunting", "turns after which the same two teeth meet again; `whole`: averaged over whole ones of them"),
    ("standard errors", "how many times its own random error a figure lies above what noise gives"),
    ("built as", "how the lines of one row hang together: harmonics, or sidebands of a shaft about them"),
    (
        "surrogate",
        "the same search at an order moved by some per cent, where nothing can be: what chance alone \
     gives",
    ),
    (
        "surrogates",
        "the same search at orders moved by some per cent, where nothing can be: what chance alone \
     gives",
    ),
    ("order", "frequency as a multiple of the pinion's turns per second"),
    ("envelope", "how the strength of the high-frequency part rises and falls: impacts repeat in it"),
    ("sideband", "line beside a mesh harmonic, at the distance of a shaft's turns: modulation once per turn"),
    ("sidebands", "lines beside a mesh harmonic, at the distance of a shaft's turns: modulation once per turn"),
    ("mesh harmonic", "multiple of the rate at which teeth meet: teeth times turns per second"),
    ("family", "lines that belong to one cause: a base order with its multiples and sidebands"),
    ("chance", "probability that noise alone gives such a finding anywhere in the whole search"),
    ("RMS", "root mean square: the usual measure of how strong a vibration is"),
    ("crest factor", "peak over RMS: impacts raise it"),
    ("kurtosis", "how peaked the values are; 3 is noise, impacts raise it"),
    ("FM0", "peak to peak of the average turn over its mesh harmonics: rises with any large fault of teeth"),
    ("FM4", "kurtosis of the average turn without its regular part: rises with one damaged tooth"),
    ("NA4", "as FM4, against the record's own past: goes on rising as damage spreads"),
    ("SER", "sidebands over their mesh harmonic: rises with modulation"),
    ("AM", "depth of the amplitude's modulation once per turn, as a share"),
    ("PM", "depth of the phase's modulation once per turn, radians"),
    ("departure", "how far a level stands over what is expected of the sound machine at this speed"),
    ("standard uncertainty", "half the width that holds two of three repeated values"),
    ("bandwidth", "frequency up to which the machine's tooth engagements have content: 0.35 over their rise time"),
    ("law", "bandwidth as a function of the shaft's speed: what the node sets its sampling rate by"),
    ("hunting period", "turns after which the same two teeth meet again"),
];

/// Escaped text with the terms in it explained.
pub fn explained(text: &str) -> String {
    let mut out = escape(text);
    for (term, meaning) in TERMS {
        if let Some(at) = place(&out, term) {
            let abbr = format!("<abbr title=\"{}\">{term}</abbr>", escape(meaning));
            out.replace_range(at..at + term.len(), &abbr);
        }
    }
    out
}

/// First place of a whole word outside tags.
fn place(text: &str, term: &str) -> Option<usize> {
    let is_letter = |byte: Option<&u8>| byte.is_some_and(u8::is_ascii_alphanumeric);
    let bytes = text.as_bytes();
    text.match_indices(term).map(|(at, _)| at).find(|&at| {
        let alone =
            !is_letter(at.checked_sub(1).and_then(|at| bytes.get(at))) && !is_letter(bytes.get(at + term.len()));
        let before = &text[..at];
        let in_tag = before.rfind('<') > before.rfind('>');
        let in_term = before.matches("<abbr").count() > before.matches("</abbr").count();
        alone && !in_tag && !in_term
    })
}

#[cfg(test)]
mod tests {
    use super::explained;

    #[test]
    fn ref_terms_are_explained_once_and_never_inside_one_another() {
        let text = explained("RMS of the held-out turns, RMS < 3");
        assert_eq!(text.matches("<abbr").count(), 2, "{text}");
        assert!(text.ends_with("RMS &lt; 3"), "{text}");
        assert_eq!(explained("LAMB"), "LAMB", "no word of a word");
        assert!(explained("sidebands").starts_with("<abbr title=\"lines beside"));
    }
}
