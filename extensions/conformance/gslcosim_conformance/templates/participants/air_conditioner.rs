//! A participant in Rust, with msgpack frames over standard input and output; needs nothing but the standard library.
//! An air conditioner that turns the inlet up while any sensor is in gas, and slowly down again afterwards.

use std::io::{self, Read, Write};

/// A value of msgpack; bytes and extensions are passed over.
enum Value {
    Nothing,
    Number(f64),
    Text(String),
    List(Vec<Value>),
    Map(Vec<(Value, Value)>),
}

impl Value {
    /// The value of a key of a map; keys that are not asked for do no harm.
    fn get(&self, key: &str) -> Option<&Value> {
        let Value::Map(pairs) = self else { return None };
        pairs.iter().find(|(name, _)| matches!(name, Value::Text(text) if text == key)).map(|(_, value)| value)
    }

    fn number(&self, key: &str) -> Option<f64> {
        match self.get(key) {
            Some(Value::Number(number)) => Some(*number),
            _ => None,
        }
    }

    fn text(&self, key: &str) -> &str {
        match self.get(key) {
            Some(Value::Text(text)) => text,
            _ => "",
        }
    }

    fn list(&self, key: &str) -> &[Value] {
        match self.get(key) {
            Some(Value::List(items)) => items,
            _ => &[],
        }
    }
}

/// Reads one message.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn bytes(&mut self, n: usize) -> &[u8] {
        assert!(self.0.len() >= n, "expected a whole message");
        let (first, rest) = self.0.split_at(n);
        self.0 = rest;
        first
    }

    fn big_endian(&mut self, n: usize) -> u64 {
        self.bytes(n).iter().fold(0, |number, byte| number << 8 | u64::from(*byte))
    }

    fn text(&mut self, n: usize) -> Value {
        Value::Text(String::from_utf8_lossy(self.bytes(n)).into_owned())
    }

    fn list(&mut self, n: usize) -> Value {
        Value::List((0..n).map(|_| self.value()).collect())
    }

    fn map(&mut self, n: usize) -> Value {
        Value::Map((0..n).map(|_| (self.value(), self.value())).collect())
    }

    fn value(&mut self) -> Value {
        let head = self.big_endian(1) as u8;
        match head {
            0x00..=0x7F => Value::Number(f64::from(head)),
            0x80..=0x8F => self.map(usize::from(head & 0x0F)),
            0x90..=0x9F => self.list(usize::from(head & 0x0F)),
            0xA0..=0xBF => self.text(usize::from(head & 0x1F)),
            0xC4..=0xC6 => {
                let n = self.big_endian(1 << (head - 0xC4)) as usize;
                self.bytes(n);
                Value::Nothing
            }
            0xCA => Value::Number(f64::from(f32::from_bits(self.big_endian(4) as u32))),
            0xCB => Value::Number(f64::from_bits(self.big_endian(8))),
            0xCC..=0xCF => Value::Number(self.big_endian(1 << (head - 0xCC)) as f64),
            0xD0 => Value::Number(f64::from(self.big_endian(1) as i8)),
            0xD1 => Value::Number(f64::from(self.big_endian(2) as i16)),
            0xD2 => Value::Number(f64::from(self.big_endian(4) as i32)),
            0xD3 => Value::Number(self.big_endian(8) as i64 as f64),
            0xD9..=0xDB => {
                let n = self.big_endian(1 << (head - 0xD9)) as usize;
                self.text(n)
            }
            0xDC | 0xDD => {
                let n = self.big_endian(2 << (head - 0xDC)) as usize;
                self.list(n)
            }
            0xDE | 0xDF => {
                let n = self.big_endian(2 << (head - 0xDE)) as usize;
                self.map(n)
            }
            0xE0..=0xFF => Value::Number(f64::from(head as i8)),
            _ => Value::Nothing, // nil, false and true
        }
    }
}

/// Writes one message.
#[derive(Default)]
struct Writer(Vec<u8>);

impl Writer {
    fn map(mut self, n: u8) -> Self {
        self.0.push(0x80 | n);
        self
    }

    fn text(mut self, text: &str) -> Self {
        self.0.extend([0xD9, text.len() as u8]);
        self.0.extend(text.as_bytes());
        self
    }

    fn texts(mut self, texts: &[&str]) -> Self {
        self.0.push(0x90 | texts.len() as u8);
        texts.iter().fold(self, |writer, text| writer.text(text))
    }

    fn whole(mut self, whole: u64) -> Self {
        self.0.push(0xCF);
        self.0.extend(whole.to_be_bytes());
        self
    }

    fn real(mut self, real: f64) -> Self {
        self.0.push(0xCB);
        self.0.extend(real.to_bits().to_be_bytes());
        self
    }

    fn truth(mut self, is_true: bool) -> Self {
        self.0.push(if is_true { 0xC3 } else { 0xC2 });
        self
    }

    fn send(self) -> io::Result<()> {
        let mut output = io::stdout().lock();
        output.write_all(&(self.0.len() as u32).to_be_bytes())?;
        output.write_all(&self.0)?;
        output.flush()
    }
}

/// The next message; none at the end of the stream.
fn receive() -> Option<Value> {
    let mut input = io::stdin().lock();
    let mut length = [0; 4];
    input.read_exact(&mut length).ok()?;
    let mut frame = vec![0; u32::from_be_bytes(length) as usize];
    input.read_exact(&mut frame).ok()?;
    Some(Reader(&frame).value())
}

/// Before its first tick nothing has been sampled.
fn is_in_gas(inputs: Option<&Value>, above_ppm: f64) -> bool {
    let samples =
        inputs.and_then(|ports| ports.get("truth/samples")).map_or(&[][..], |message| message.list("samples"));
    samples
        .iter()
        .flat_map(|sample| sample.list("gases"))
        .any(|gas| gas.number("mixing_ratio_ppm").expect("a mixing ratio") > above_ppm)
}

fn main() -> io::Result<()> {
    let (mut above_ppm, mut full_share, mut most_change, mut share) = (1.0, 3.0, 0.1, 1.0_f64);
    let mut n_ticks = 0;
    let hello = Writer::default().map(3).text("tick").whole(0);
    hello.text("reads").texts(&["truth/samples"]).text("writes").texts(&["ventilation", "state"]).send()?;
    while let Some(message) = receive() {
        match message.text("message") {
            "Ending" => break,
            "ParticipantBriefing" => {
                let parameter = |name| message.get("parameters").and_then(|given| given.number(name));
                above_ppm = parameter("above_ppm").unwrap_or(above_ppm);
                full_share = parameter("full_share").unwrap_or(full_share);
                let of_briefing = |name| message.number(name).expect(name);
                let period_s = of_briefing("period_ticks") * of_briefing("tick_ns") / 1e9;
                most_change = f64::abs(full_share - 1.0) * period_s / parameter("ramp_s").unwrap_or(2.0);
            }
            "ParticipantInputs" => {
                let has_gas = is_in_gas(message.get("inputs"), above_ppm);
                n_ticks += u64::from(has_gas);
                let wanted = if has_gas { full_share } else { 1.0 };
                share += f64::max(-most_change, f64::min(most_change, wanted - share));
                let tick = message.number("tick").expect("a tick") as u64;
                let answer = Writer::default().map(2).text("tick").whole(tick).text("outputs").map(2);
                let answer = answer.text("ventilation").map(1).text("share").real(share);
                let answer = answer.text("state").map(2).text("is_in_gas").truth(has_gas);
                answer.text("n_ticks").whole(n_ticks).send()?;
            }
            _ => {}
        }
    }
    Ok(())
}
