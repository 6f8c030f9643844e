//! An MCAP file, read as far as it goes: what is damaged or cut off is left out, and told.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use lz4_flex::frame::FrameDecoder;
use mcap::records::{Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{MAGIC, McapError};
use ruzstd::decoding::StreamingDecoder;

use crate::error::LinkError;

/// The largest record, and the largest chunk once unpacked, that is read into memory; recorders use a few MB.
const MOST_BYTES: u64 = 256 << 20;
/// Opcode and length before each record.
const HEAD: u64 = 9;
/// The footer and its head, and the closing magic.
const FOOTER: u64 = HEAD + 20 + 8;
/// Damages that are told one by one.
const MOST_TOLD: usize = 5;

/// A channel of the file: who sent what, how.
#[derive(Clone, Debug, Default)]
pub(crate) struct Channel {
    pub topic: String,
    pub encoding: String,
    /// Name of the message's type.
    pub schema: String,
}

/// A message as it lies in the file.
pub(crate) struct Raw<'a> {
    pub channel: &'a Channel,
    pub channel_id: u16,
    pub log_time_ns: u64,
    pub data: &'a [u8],
}

/// What was found beside the messages.
#[derive(Clone, Debug, Default)]
pub(crate) struct Findings {
    /// What is damaged or cut off, and where.
    pub damages: Vec<String>,
    /// The topics that it describes, with the number of messages that it says it has, if it was closed.
    pub promised: BTreeMap<String, u64>,
}

/// Why the walk over a file's records stopped.
enum Stop {
    /// The end of its data.
    Closed,
    /// The end of the file, between two records.
    Unclosed,
    /// A record that is not whole: its opcode and length.
    Cut(u8, u64),
    /// A record that no recorder writes: its opcode and length.
    Unlikely(u8, u64),
    Io(std::io::Error),
}

/// Hands every message of an MCAP file to `visit`, in the file's order.
///
/// # Errors
///
/// [`LinkError::Log`] if the file cannot be opened or is no MCAP file. What is damaged in one is no error.
pub(crate) fn read(path: &Path, visit: &mut dyn FnMut(&Raw<'_>)) -> Result<Findings, LinkError> {
    let fault = |problem: String| LinkError::Log { path: path.into(), problem };
    let io = |error: std::io::Error| fault(error.to_string());
    let about = std::fs::metadata(path).map_err(io)?;
    if about.is_dir() {
        let problem = "is a directory; name the .mcap file in it";
        return Err(fault(problem.into()));
    }
    if !about.is_file() {
        return Err(fault("is no regular file".into()));
    }
    let mut file =
        LogFile { bytes: BufReader::with_capacity(1 << 16, File::open(path).map_err(io)?), length: about.len() };
    let head = file.read(0, file.length.min(64)).map_err(io)?;
    if !head.starts_with(MAGIC) {
        return Err(fault(foreign(&head)));
    }
    let mut contents = Contents {
        visit,
        schemas: BTreeMap::new(),
        channels: BTreeMap::new(),
        chunks: BTreeSet::new(),
        counts: BTreeMap::new(),
        orphans: 0,
        illegible: 0,
        damages: Vec::new(),
        more: 0,
    };
    contents.summary(&mut file);
    contents.walk_all(&mut file);
    Ok(contents.findings())
}

/// What a file that is no MCAP file is instead.
fn foreign(head: &[u8]) -> String {
    let known: [(&[u8], &str); 6] = [
        (
            b"SQLite format 3\0",
            "a SQLite database (a ROS 2 bag of the older kind): `ros2 bag convert` makes an MCAP file of it",
        ),
        (b"#ROSBAG", "a bag of ROS 1: convert it to a ROS 2 bag in MCAP form"),
        (b"\x28\xb5\x2f\xfd", "a file that zstd compressed as a whole: unpack it with `unzstd` first"),
        (b"\x04\x22\x4d\x18", "a file that lz4 compressed as a whole: unpack it with `unlz4` first"),
        (b"\x1f\x8b", "a file that gzip compressed as a whole: unpack it with `gunzip` first"),
        (b"", "an empty file"),
    ];
    let is = |magic: &[u8]| {
        if magic.is_empty() { head.is_empty() } else { head.starts_with(magic) }
    };
    match known.iter().find(|(magic, _)| is(magic)) {
        Some((_, what)) => format!("is no MCAP file but {what}"),
        None => format!("is no MCAP file: it begins with {:?}", String::from_utf8_lossy(&head[..head.len().min(16)])),
    }
}

struct LogFile {
    bytes: BufReader<File>,
    length: u64,
}

impl LogFile {
    fn read(&mut self, at: u64, count: u64) -> std::io::Result<Vec<u8>> {
        let here = self.bytes.stream_position()?;
        match i64::try_from(i128::from(at) - i128::from(here)) {
            Ok(way) => self.bytes.seek_relative(way)?,
            Err(_) => {
                self.bytes.seek(SeekFrom::Start(at))?;
            }
        }
        let mut bytes = Vec::new();
        Read::by_ref(&mut self.bytes).take(count).read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    /// Walks over whole records from a place on; each is handed over with its place and head. Where it stopped,
    /// and why.
    fn walk(&mut self, from: u64, on: &mut dyn FnMut(u64, u8, &[u8])) -> (u64, Stop) {
        let mut at = from;
        loop {
            let left = self.length.saturating_sub(at);
            if left == 0 {
                return (at, Stop::Unclosed);
            }
            let head = match self.read(at, HEAD) {
                Ok(head) => head,
                Err(error) => return (at, Stop::Io(error)),
            };
            let (Some(&opcode), Some(length)) = (head.first(), head.get(1..).and_then(number)) else {
                return (at, Stop::Cut(head.first().copied().unwrap_or(0), 0));
            };
            if opcode == op::DATA_END || opcode == op::FOOTER {
                return (at, Stop::Closed);
            }
            if opcode == 0 || (opcode > op::DATA_END && opcode < 0x80) {
                return (at, Stop::Unlikely(opcode, length));
            }
            if length > left - HEAD.min(left) {
                return (at, Stop::Cut(opcode, length));
            }
            if CARRIED.contains(&opcode) {
                if length > MOST_BYTES {
                    return (at, Stop::Unlikely(opcode, length));
                }
                match self.read(at, HEAD + length) {
                    Ok(record) => on(at, opcode, &record),
                    Err(error) => return (at, Stop::Io(error)),
                }
            }
            at += HEAD + length;
        }
    }
}

/// Records that are looked into.
const CARRIED: [u8; 6] = [op::SCHEMA, op::CHANNEL, op::MESSAGE, op::CHUNK, op::CHUNK_INDEX, op::STATISTICS];

/// Eight bytes as a number, least first.
fn number(bytes: &[u8]) -> Option<u64> {
    Some(u64::from_le_bytes(bytes.get(..8)?.try_into().ok()?))
}

/// A chunk's record with its records unpacked; of one that is not `whole`, as far as they can be.
fn unpacked(record: &[u8], whole: bool) -> Result<Cow<'_, [u8]>, String> {
    // Opcode, length; times, size, checksum; the packing's name and the packed records, each after its length.
    const NAME: usize = HEAD as usize + 28;
    let cut = || "cannot be read: it is too short".to_owned();
    let name_length = record.get(NAME..NAME + 4).and_then(|b| Some(u32::from_le_bytes(b.try_into().ok()?)));
    let name_end = name_length.and_then(|n| (NAME + 4).checked_add(n as usize)).ok_or_else(cut)?;
    let name = record.get(NAME + 4..name_end).ok_or_else(cut)?;
    let packed = record.get(name_end + 8..).ok_or_else(cut)?;
    let most = record.get(HEAD as usize + 16..).and_then(number).unwrap_or(0).min(MOST_BYTES);
    let mut records = Vec::new();
    let read = match name {
        b"" => return Ok(record.into()),
        b"zstd" => match StreamingDecoder::new(packed) {
            Ok(decoder) => decoder.take(most).read_to_end(&mut records).map_err(|e| e.to_string()),
            Err(error) => Err(error.to_string()),
        },
        b"lz4" => FrameDecoder::new(packed).take(most).read_to_end(&mut records).map_err(|e| e.to_string()),
        other => {
            let other = String::from_utf8_lossy(other);
            return Err(format!("is compressed with {other:?}; zstd and lz4 can be read"));
        }
    };
    if let (Err(error), true) = (read, whole) {
        return Err(format!("cannot be read: {error}"));
    }
    // The same chunk, packed by nobody: no name, and of one that was cut off the size that is there.
    let length = (28 + 4 + 8 + records.len()) as u64;
    let there = (records.len() as u64).to_le_bytes();
    let mut head = record[..NAME].to_vec();
    head[1..HEAD as usize].copy_from_slice(&length.to_le_bytes());
    if !whole {
        head[HEAD as usize + 16..HEAD as usize + 24].copy_from_slice(&there);
    }
    Ok([&head[..], &[0; 4], &there, &records].concat().into())
}

struct Contents<'v> {
    visit: &'v mut dyn FnMut(&Raw<'_>),
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, Channel>,
    /// Where chunks begin, as the index says.
    chunks: BTreeSet<u64>,
    /// Messages per channel, as the statistics say.
    counts: BTreeMap<u16, u64>,
    /// Messages of channels that nobody described.
    orphans: u64,
    /// Records that cannot be read.
    illegible: u64,
    damages: Vec<String>,
    more: u64,
}

impl Contents<'_> {
    fn damage(&mut self, what: String) {
        if self.damages.len() < MOST_TOLD {
            self.damages.push(what);
        } else {
            self.more += 1;
        }
    }

    /// Channels, counts and index of a file that was closed.
    fn summary(&mut self, file: &mut LogFile) {
        let Some(at) = file.length.checked_sub(FOOTER) else {
            return;
        };
        let Ok(footer) = file.read(at, FOOTER) else {
            return;
        };
        let start = footer.get(HEAD as usize..).and_then(number).unwrap_or(0);
        let closed = footer.ends_with(MAGIC) && footer.first() == Some(&op::FOOTER);
        if closed && start >= MAGIC.len() as u64 && start < at {
            file.walk(start, &mut |_, opcode, record| {
                if opcode != op::MESSAGE && opcode != op::CHUNK {
                    self.record(opcode, &record[HEAD as usize..]);
                }
            });
        }
    }

    /// Walks over the data; past a damage the index of the chunks leads on.
    fn walk_all(&mut self, file: &mut LogFile) {
        let mut from = MAGIC.len() as u64;
        loop {
            let (at, stop) = file.walk(from, &mut |at, opcode, record| {
                if opcode == op::CHUNK {
                    self.chunk(at, record, true);
                } else {
                    self.record(opcode, &record[HEAD as usize..]);
                }
            });
            let next = self.chunks.range(at + 1..).next().copied();
            let left = match next {
                Some(next) => format!("; the {} bytes up to the next chunk are left out", next - at),
                None => format!("; the {} bytes from there on are left out", file.length - at),
            };
            match stop {
                Stop::Closed => return,
                Stop::Unclosed => {
                    self.damage(format!("was not closed: it ends at byte {at}, and what came after that is lost"))
                }
                Stop::Cut(opcode, length) if next.is_none() => {
                    self.damage(format!(
                        "is cut off or damaged: the record at byte {at} has {length} bytes, and the file only {} more",
                        file.length.saturating_sub(at + HEAD)
                    ));
                    if opcode == op::CHUNK
                        && let Ok(record) = file.read(at, MOST_BYTES)
                    {
                        self.chunk(at, &record, false);
                    }
                }
                Stop::Cut(opcode, length) | Stop::Unlikely(opcode, length) => self.damage(format!(
                    "is damaged at byte {at}: no recorder writes a record of kind {opcode} with {length} bytes{left}"
                )),
                Stop::Io(error) => self.damage(format!("cannot be read at byte {at}: {error}{left}")),
            }
            match next {
                Some(next) => from = next,
                None => return,
            }
        }
    }

    /// The records of a chunk. A whole one is checked before any of it is believed; of one that was cut off there
    /// is nothing to check it by.
    fn chunk(&mut self, at: u64, record: &[u8], whole: bool) {
        let mut taken = 0_u64;
        let read = unpacked(record, whole).and_then(|record| self.records_of(&record, whole, &mut taken));
        if let Err(why) = read
            && whole
        {
            let length = record.len();
            self.damage(format!(
                "is damaged: the chunk at byte {at} ({length} bytes) {why}; it is left out after its first {taken} records"
            ));
        }
    }

    /// The records of a chunk that is not packed, and how many were taken.
    fn records_of(&mut self, record: &[u8], whole: bool, taken: &mut u64) -> Result<(), String> {
        let mut options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_record_length_limit(MOST_BYTES as usize);
        options.prevalidate_chunk_crcs = whole;
        let mut reader = LinearReader::new_with_options(options);
        let mut rest = record;
        while let Some(event) = reader.next_event() {
            match event {
                Ok(LinearReadEvent::ReadRequest(wanted)) => {
                    let (now, later) = rest.split_at(wanted.min(rest.len()));
                    reader.insert(now.len()).copy_from_slice(now);
                    reader.notify_read(now.len());
                    rest = later;
                }
                Ok(LinearReadEvent::Record { data, opcode }) => {
                    *taken += 1;
                    self.record(opcode, data);
                }
                Err(McapError::BadChunkCrc { .. }) => return Err("does not match its checksum".into()),
                Err(other) => return Err(format!("cannot be read: {other}")),
            }
        }
        Ok(())
    }

    fn record(&mut self, opcode: u8, data: &[u8]) {
        if !CARRIED.contains(&opcode) || opcode == op::CHUNK {
            return;
        }
        match mcap::parse_record(opcode, data) {
            Ok(Record::Schema { header, .. }) => {
                self.schemas.insert(header.id, header.name);
            }
            Ok(Record::Channel(channel)) => {
                let schema = self.schemas.get(&channel.schema_id).cloned();
                let described = Channel {
                    topic: channel.topic,
                    encoding: channel.message_encoding,
                    schema: schema.unwrap_or_default(),
                };
                self.channels.insert(channel.id, described);
            }
            Ok(Record::Message { header, data }) => match self.channels.get(&header.channel_id) {
                Some(channel) => (self.visit)(&Raw {
                    channel,
                    channel_id: header.channel_id,
                    log_time_ns: header.log_time,
                    data: &data,
                }),
                None => self.orphans += 1,
            },
            Ok(Record::ChunkIndex(index)) => {
                self.chunks.insert(index.chunk_start_offset);
            }
            Ok(Record::Statistics(statistics)) => self.counts = statistics.channel_message_counts,
            Ok(_) => {}
            Err(_) => self.illegible += 1,
        }
    }

    fn findings(mut self) -> Findings {
        if self.more > 0 {
            self.damages.push(format!("and {} more such places", self.more));
        }
        if self.illegible > 0 {
            let count = self.illegible;
            self.damages.push(format!("is damaged: {count} records cannot be read"));
        }
        if self.orphans > 0 {
            let count = self.orphans;
            self.damages.push(format!("is damaged: {count} messages are on channels that it does not describe"));
        }
        let mut promised: BTreeMap<String, u64> = BTreeMap::new();
        for (id, channel) in self.channels {
            let count = self.counts.get(&id).copied().unwrap_or(0);
            let sum = promised.entry(channel.topic).or_default();
            *sum = sum.saturating_add(count);
        }
        Findings { damages: self.damages, promised }
    }
}
