//! Search methods in Rust: `searchers METHOD` speaks lines of JSON on standard input and output.
//! Each method answers the same observations with the same commands as its Python namesake in `agents/`.

mod common;
mod e_coli;
mod messages;
mod piloting;
mod sensing;
mod surge_cast;
mod unseen;

use std::error::Error;
use std::io::{Write, stdin, stdout};

use common::Method;
use e_coli::EColi;
use messages::{Briefing, Message};
use surge_cast::SurgeCast;

type Maker = fn(&Briefing) -> Result<Box<dyn Method>, String>;

const MAKERS: [(&str, Maker); 2] = [
    ("e_coli", |briefing| Ok(Box::new(EColi::new(briefing)?))),
    ("surge_cast", |briefing| Ok(Box::new(SurgeCast::new(briefing)?))),
];

fn main() -> Result<(), Box<dyn Error>> {
    let wanted = std::env::args().nth(1).unwrap_or_default();
    let found = MAKERS.iter().find(|(name, _)| *name == wanted);
    let names = MAKERS.map(|(name, _)| name).join(", ");
    let (_, make) = found.ok_or_else(|| format!("expected the name of one method ({names}), was '{wanted}'"))?;
    fly(*make)
}

fn fly(make: Maker) -> Result<(), Box<dyn Error>> {
    let mut method: Option<Box<dyn Method>> = None;
    for line in stdin().lines() {
        match serde_json::from_str(&line?)? {
            Message::Ending => return Ok(()),
            Message::Briefing(briefing) => {
                if !briefing.contract_version.starts_with("1.") {
                    return Err(format!("expected contract version 1, was {}", briefing.contract_version).into());
                }
                method = Some(make(&briefing)?);
            }
            Message::Observation(seen) => {
                let method = method.as_mut().ok_or("expected a briefing before the first observation")?;
                method.observe(&seen)?;
                if seen.awaiting_command {
                    let mut output = stdout().lock();
                    serde_json::to_writer(&mut output, &method.decide(&seen)?)?;
                    output.write_all(b"\n")?;
                    output.flush()?; // the run waits for it
                }
            }
        }
    }
    Ok(())
}
