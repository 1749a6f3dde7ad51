//! The dung beetle over native Zenoh: joins the run, answers each observation that awaits a command, leaves.

mod beetle;
mod messages;

use std::error::Error;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::Duration;

use beetle::DungBeetle;
use messages::{Briefing, Join, Observation};
use serde_json::json;
use zenoh::bytes::ZBytes;
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;
use zenoh::{Config, Session, Wait};

const LINK_CHECK_EVERY: Duration = Duration::from_millis(500);

type Result<T> = std::result::Result<T, Box<dyn Error + Send + Sync>>;

fn main() -> Result<()> {
    let join = join()?;
    let session = zenoh::open(config(&join)?).wait()?;
    fly(&session, &join.name)?;
    session.close().wait()
}

/// Returns the join data in the environment: JSON, or the path of a file with it.
fn join() -> Result<Join> {
    let text = std::env::var("GSLCOSIM_JOIN").map_err(|_| "GSLCOSIM_JOIN is not set; `gslcosim up` sets it")?;
    let text = if text.starts_with('{') { text } else { std::fs::read_to_string(text)? };
    Ok(serde_json::from_str(&text)?)
}

/// Returns the settings of a client that knows the run's router and looks for no other.
fn config(join: &Join) -> Result<Config> {
    let mut config = Config::default();
    for (key, value) in [
        ("mode", json!("client")),
        ("namespace", json!(join.namespace)),
        ("connect/endpoints", json!([join.endpoint])),
        ("scouting/multicast/enabled", json!(false)),
        ("scouting/gossip/enabled", json!(false)),
        ("transport/auth/usrpwd/user", json!(join.user)),
        ("transport/auth/usrpwd/password", json!(join.password)),
    ] {
        config.insert_json5(key, &value.to_string())?;
    }
    Ok(config)
}

/// What comes from the run, in the order in which it came.
enum Event {
    Briefing(ZBytes),
    Observation(ZBytes),
    Ending,
}

type ToEvent = fn(ZBytes) -> Event;

/// Answers observations until the run is over.
fn fly(session: &Session, name: &str) -> Result<()> {
    let (events, inbox) = mpsc::channel();
    let channels: [(&str, ToEvent); 3] =
        [("briefing", Event::Briefing), ("observation", Event::Observation), ("ending", |_| Event::Ending)];
    let mut subscribers = Vec::new();
    for (channel, event) in channels {
        let events = events.clone();
        let subscriber = session
            .declare_subscriber(format!("agents/{name}/{channel}"))
            .callback(move |sample| _ = events.send(event(sample.payload().clone())))
            .wait()?;
        subscribers.push(subscriber); // Zenoh undeclares what nobody holds.
    }
    let commands = session
        .declare_publisher(format!("agents/{name}/command"))
        .encoding("application/msgpack;gslcosim.Command/1")
        .congestion_control(CongestionControl::Block)
        .express(true)
        .wait()?;
    // Last, for it says that the agent is ready.
    let _alive = session.liveliness().declare_token(format!("agents/{name}/alive")).wait()?;
    answer_all(session, &inbox, &commands)
}

fn answer_all(session: &Session, inbox: &Receiver<Event>, commands: &Publisher) -> Result<()> {
    let mut beetle = None;
    let mut last: Option<(u64, Vec<u8>)> = None;
    loop {
        match inbox.recv_timeout(LINK_CHECK_EVERY) {
            Ok(Event::Briefing(payload)) if beetle.is_none() => {
                let briefing: Briefing = rmp_serde::from_slice(&payload.to_bytes())?;
                beetle = Some(DungBeetle::new(&briefing)?);
            }
            Ok(Event::Briefing(_)) => {} // a repetition
            Ok(Event::Observation(payload)) => {
                let seen: Observation = rmp_serde::from_slice(&payload.to_bytes())?;
                if let (true, Some(beetle)) = (seen.awaiting_command, &mut beetle) {
                    // A question may come twice. It gets the same answer again, and is not decided anew.
                    if last.as_ref().is_none_or(|(tick, _)| *tick < seen.tick) {
                        last = Some((seen.tick, rmp_serde::to_vec_named(&beetle.decide(&seen)?)?));
                    }
                    if let Some((_, answer)) = last.as_ref().filter(|(tick, _)| *tick == seen.tick) {
                        commands.put(answer.as_slice()).wait()?;
                    }
                }
            }
            Err(RecvTimeoutError::Timeout) if session.info().routers_zid().wait().next().is_some() => {}
            Ok(Event::Ending) | Err(_) => return Ok(()), // the run is over, or the link to it was lost
        }
    }
}
