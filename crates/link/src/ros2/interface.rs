//! Keeps a DDS participant to one network interface of this machine.
//!
//! RustDDS opens its sockets on 0.0.0.0 and `only_networks` chooses only what it advertises, so whoever knows
//! a port can command. Its sockets are therefore bound to the device (`SO_BINDTODEVICE`) as soon as they are
//! open: the kernel then delivers nothing that was sent to another interface's address, from this machine
//! neither, and sends nothing elsewhere. On loopback a filter in the kernel (`SO_ATTACH_FILTER`) also drops
//! what comes from another address of this machine.
//!
//! Between a socket's opening and its binding lie about a millisecond and no reader: endpoints are created
//! afterwards. What arrives in between can announce a participant, which then can neither be heard nor reached.

use std::io::{Error, IoSlice, IoSliceMut, Result as IoResult};
use std::mem::MaybeUninit;
use std::net::Ipv4Addr;
use std::os::fd::{AsRawFd, OwnedFd, RawFd};
use std::os::unix::net::UnixDatagram;
use std::sync::{Mutex, PoisonError};

use nix::ifaddrs::getifaddrs;
use nix::sys::socket::{ControlMessage, MsgFlags, sendmsg};
use rustix::net::{RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, recvmsg};
use socket2::{SockFilter, SockRef, Type};
use stridemap_robot::Ros2Config;

use crate::error::LinkError;

/// The longest time that the link may wait for anything: a day.
const LONGEST_S: f64 = 86_400.0;

/// Refuses a domain that DDS does not have, times that are none, and an interface that this machine does not have.
///
/// # Errors
///
/// [`LinkError::Config`] that names the key and, for an interface, those that there are.
pub fn check_network(config: &Ros2Config) -> Result<(), LinkError> {
    Interface::of(config).map(|_| ())
}

/// An IPv4 address of this machine and the device that has it.
#[derive(Clone, Debug)]
pub(crate) struct Interface {
    pub address: Ipv4Addr,
    device: String,
}

impl Interface {
    /// The interface of a network, whose other numbers are looked at as well.
    pub fn of(config: &Ros2Config) -> Result<Self, LinkError> {
        if config.domain > 232 {
            return Err(LinkError::Config {
                field: "domain",
                value: config.domain.to_string(),
                problem: "domains are 0 to 232".into(),
            });
        }
        for (field, seconds) in [
            ("connect_s", config.connect_s),
            ("silence_s", config.silence_s),
            ("gap_s", config.gap_s),
            ("ramp_s", config.ramp_s),
        ] {
            if !(0.0..=LONGEST_S).contains(&seconds) {
                return Err(LinkError::Config {
                    field,
                    value: format!("{seconds:?}"),
                    problem: format!("must be 0 to {LONGEST_S} seconds"),
                });
            }
        }
        let refused =
            |problem: String| LinkError::Config { field: "interface", value: config.interface.clone(), problem };
        let parsed: Ipv4Addr = config
            .interface
            .parse()
            .map_err(|_| refused("must be the IPv4 address of one of this machine's interfaces".into()))?;
        let own: Vec<(Ipv4Addr, String)> = getifaddrs()
            .map_err(|e| LinkError::Network(format!("interfaces cannot be listed: {e}")))?
            .filter_map(|i| Some((i.address?.as_sockaddr_in()?.ip(), i.interface_name)))
            .collect();
        match own.iter().find(|(ip, _)| *ip == parsed) {
            Some((_, name)) => Ok(Self {
                address: parsed,
                // The name of a second address may have a label: eth0:1.
                device: name.split(':').next().unwrap_or(name).to_owned(),
            }),
            None => {
                let known = own.iter().map(|(ip, name)| format!("{ip} ({name})"));
                let known = known.collect::<Vec<_>>().join(", ");
                Err(refused(format!("this machine has no interface with that address; it has {known}")))
            }
        }
    }

    /// Opens sockets and keeps them, and all other UDP sockets of this process that are not kept to a device
    /// yet, to this interface.
    pub fn keep<T>(&self, open: impl FnOnce() -> Result<T, LinkError>) -> Result<T, LinkError> {
        /// Two participants that open at once must not bind each other's sockets.
        static OPENING: Mutex<()> = Mutex::new(());
        let _alone = OPENING.lock().unwrap_or_else(PoisonError::into_inner);
        let opened = open()?;
        self.bind_sockets().map_err(|e| {
            LinkError::Network(format!(
                "its sockets cannot be kept to interface {} ({e}; needs Linux 5.7 or newer, and /proc)",
                self.device
            ))
        })?;
        Ok(opened)
    }

    fn bind_sockets(&self) -> IoResult<()> {
        let (from, to) = UnixDatagram::pair()?;
        for entry in std::fs::read_dir("/proc/self/fd")? {
            let Some(fd) = entry?.file_name().to_str().and_then(|n| n.parse().ok()) else {
                continue;
            };
            // It may be closed by now.
            let Ok(Some(file)) = second_handle(fd, &from, &to) else {
                continue;
            };
            let socket = SockRef::from(&file);
            let is_ip = || socket.local_addr().is_ok_and(|a| a.as_socket().is_some());
            if !(socket.r#type().is_ok_and(|t| t == Type::DGRAM) && is_ip()) {
                continue;
            }
            if socket.device()?.is_some() {
                continue;
            }
            if self.address.is_loopback() {
                socket.attach_filter(&FROM_LOOPBACK)?;
            }
            socket.bind_device(Some(self.device.as_bytes()))?;
        }
        Ok(())
    }
}

/// Keeps what was sent from 127.0.0.0/8, drops the rest.
const FROM_LOOPBACK: [SockFilter; 5] = {
    /// The IP header from here on (`SKF_NET_OFF`); its source address is at 12.
    const SOURCE: u32 = (-0x10_0000_i32 + 12).cast_unsigned();
    const LOAD_WORD: u16 = 0x20;
    const AND: u16 = 0x54;
    const JUMP_IF_EQUAL: u16 = 0x15;
    const RETURN: u16 = 0x06;
    [
        SockFilter::new(LOAD_WORD, 0, 0, SOURCE),
        SockFilter::new(AND, 0, 0, 0xff00_0000),
        SockFilter::new(JUMP_IF_EQUAL, 0, 1, 0x7f00_0000),
        SockFilter::new(RETURN, 0, 0, u32::MAX),
        SockFilter::new(RETURN, 0, 0, 0),
    ]
};

/// A handle of one's own to an open file of this process, by its number: sent to oneself through a pair of
/// sockets, which needs neither `unsafe` nor a privilege.
fn second_handle(fd: RawFd, from: &UnixDatagram, to: &UnixDatagram) -> IoResult<Option<OwnedFd>> {
    sendmsg::<()>(
        from.as_raw_fd(),
        &[IoSlice::new(&[0])],
        &[ControlMessage::ScmRights(&[fd])],
        MsgFlags::empty(),
        None,
    )
    .map_err(Error::from)?;
    let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(1))];
    let mut control = RecvAncillaryBuffer::new(&mut space);
    let mut byte = [0];
    recvmsg(to, &mut [IoSliceMut::new(&mut byte)], &mut control, RecvFlags::CMSG_CLOEXEC)?;
    Ok(control.drain().find_map(|message| match message {
        RecvAncillaryMessage::ScmRights(mut files) => files.next(),
        _ => None,
    }))
}
