//! Connects base stations through a broker: MQTT 5, by the `rumqttc-v5-next` crate (decision 19).
//!
//! **A carrier like the others.** Objects and verdicts are published ([`published`]). The broker is not trusted: a
//! subscriber judges, records and shows the objects as if they had come over a line.
//!
//! **Live, not stored.** The quality of service is 0, no message is retained, and no session outlives its connection. A
//! stored message would be old when it arrives, and the next one comes a tenth of a second later. Messages that cannot
//! be published are counted and reported; the publishing station's recording has them.
//!
//! **Reconnection.** A connection that ends is made anew after [`RETRY`]. A connection without traffic for [`SILENCE`]
//! is ended, because the broker should answer a ping every [`KEEP_ALIVE_S`].
//!
//! **TLS**, where requested, encrypts the connection and authenticates the broker ([`tls`](super::tls)).

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::Duration;

use rumqttc::{AsyncClient, ConnectionError, Event as Mqtt, EventLoop, MqttOptions, PublishOptions, QoS};
use rumqttc::{Packet, Publish, SubAck, SubscribeReasonCode};
use tokio::runtime::{Builder, Runtime};
use tokio::time::{sleep, timeout};

use super::tls::Tls;
use super::{Clock, Event, Inlet};
use crate::carrier::published::{self, MAX_MESSAGE, Name, TOPICS};
use crate::intake::{Carried, Kind};
use crate::{Bundle, DroneId, Verdict, Who};

/// The time from a failure of the connection to the next attempt.
pub const RETRY: Duration = Duration::from_millis(500);

/// The interval of pings to the broker, s.
pub const KEEP_ALIVE_S: u16 = 5;

/// The time without traffic after which a connection is ended.
pub const SILENCE: Duration = Duration::from_secs(12);

/// The greatest number of messages that may wait to be sent: those of a thousand drones at 10 Hz in 0.3 s.
const WAITING: usize = 3_000;

const MAX_PACKET: u32 = MAX_MESSAGE as u32 + 1_024;

/// A broker's address and login.
#[derive(Clone)]
pub struct Broker {
    /// The name or the address of the broker.
    pub host: String,
    /// The port of the broker; by custom 1883, with TLS 8883.
    pub port: u16,
    /// User and password, if the broker needs them. Only TLS encrypts them.
    pub login: Option<(String, String)>,
    /// The settings of TLS, if it is used.
    pub tls: Option<Tls>,
}

/// The output hides the password, which must not get into logs.
impl std::fmt::Debug for Broker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{self}")
    }
}

impl std::fmt::Display for Broker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let scheme = if self.tls.is_some() { "mqtts://" } else { "" };
        write!(f, "broker {scheme}{}:{}", self.host, self.port)
    }
}

impl Broker {
    fn options(&self) -> MqttOptions {
        // Without a client id the broker assigns one, so that no station can take over another one's session.
        let mut options = MqttOptions::new("", (self.host.as_str(), self.port));
        options.set_keep_alive(KEEP_ALIVE_S).set_clean_start(true).set_max_packet_size(Some(MAX_PACKET));
        if let Some((user, password)) = &self.login {
            options.set_credentials(user, password.clone());
        }
        if let Some(tls) = &self.tls {
            options.set_transport(tls.transport());
        }
        options
    }

    fn words(&self, error: &ConnectionError) -> String {
        let tls = self.tls.as_ref().and_then(|tls| tls.words(error, &self.host));
        tls.unwrap_or_else(|| error.to_string())
    }
}

/// Passes a station's judged objects on to a broker.
#[derive(Clone, Debug)]
pub struct Outlet {
    station: Arc<str>,
    client: AsyncClient,
    connected: Arc<AtomicBool>,
    unpublished: Arc<AtomicU64>,
}

impl Outlet {
    /// Passes on the objects of a drone that arrived at `at_us`, µs since 1970, with the verdicts. Counts them as lost
    /// if there is no connection or too many messages wait. Never blocks.
    pub fn offer(&self, drone: DroneId, at_us: u64, bundle: &Bundle<'_>, verdicts: &[Verdict]) {
        // Data that came from a broker are not published again, because two brokers that feed each other would form a
        // loop.
        if matches!(drone.who, Who::Named(_)) {
            return;
        }
        let topic = || published::topic(&self.station, drone);
        let message = || published::message(at_us, bundle, verdicts);
        let published = self.connected.load(Ordering::Relaxed)
            && self.client.try_publish(topic(), message(), PublishOptions::at_most_once()).is_ok();
        if !published {
            self.unpublished.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Returns the number of messages that were not passed on.
    #[must_use]
    pub fn unpublished(&self) -> u64 {
        self.unpublished.load(Ordering::Relaxed)
    }
}

/// The sending side of an [`Outlet`] that is not connected to the broker yet.
pub struct Unconnected {
    broker: Broker,
    events: EventLoop,
    outlet: Outlet,
}

/// Returns an outlet to a broker for the station of this name ([`is_station`](published::is_station)). Nothing is
/// published before [`connect`](Unconnected::connect).
#[must_use]
pub fn outlet(broker: Broker, station: &str) -> (Outlet, Unconnected) {
    let (client, events) = AsyncClient::builder(broker.options()).capacity(WAITING).build();
    let outlet = Outlet {
        station: station.into(),
        client,
        connected: Arc::new(AtomicBool::new(false)),
        unpublished: Arc::new(AtomicU64::new(0)),
    };
    (outlet.clone(), Unconnected { broker, events, outlet })
}

impl Unconnected {
    /// Connects to the broker, on a thread of its own, until the station ends. Errors are reported through `inlet`.
    ///
    /// # Errors
    ///
    /// Returns an error if the system provides no event loop.
    pub fn connect(self, inlet: Inlet) -> io::Result<()> {
        let Self { broker, events, outlet } = self;
        spawn(broker, events, inlet, move |event| {
            match event {
                Happened::Connected => outlet.connected.store(true, Ordering::Relaxed),
                Happened::Lost => outlet.connected.store(false, Ordering::Relaxed),
                Happened::Came(_) => {}
            }
            true
        })
    }
}

/// Receives the messages of all stations or, if `station` is given, of that one, on a thread of its own until the
/// receiving station ends. `line` is the number of this line in recordings.
///
/// # Errors
///
/// Returns an error if the system provides no event loop.
pub fn subscribe(broker: Broker, station: Option<&str>, line: u16, clock: Clock, inlet: Inlet) -> io::Result<()> {
    let (client, events) = AsyncClient::builder(broker.options()).capacity(16).build();
    let filter = format!("{TOPICS}/{}/+", station.unwrap_or("+"));
    let to = inlet.clone();
    spawn(broker, events, inlet, move |event| match event {
        // A new connection needs a new subscription. The client's queue has room for the subscription, because the
        // queue was emptied when the last connection ended.
        Happened::Connected => client.try_subscribe(filter.clone(), QoS::AtMostOnce).is_ok(),
        Happened::Lost => true,
        Happened::Came(published) => {
            let topic = std::str::from_utf8(&published.topic).ok();
            // A retained message does not state its age, so it is refused.
            match topic.and_then(Name::of_topic).filter(|_| !published.retain) {
                Some(name) => {
                    let (from, bytes) = (name.as_str().to_owned(), published.payload.to_vec());
                    let carried = Carried { at_us: clock.now_us(), kind: Kind::Published, line, from, bytes };
                    to.offer(Event::Carried(carried))
                }
                None => true,
            }
        }
    })
}

enum Happened<'a> {
    Connected,
    Lost,
    Came(&'a Publish),
}

fn is_granted(answer: &SubAck) -> bool {
    answer.return_codes.iter().all(|code| matches!(code, SubscribeReasonCode::Success(_)))
}

fn spawn(
    broker: Broker,
    mut events: EventLoop,
    inlet: Inlet,
    mut each: impl FnMut(Happened<'_>) -> bool + Send + 'static,
) -> io::Result<()> {
    let runtime: Runtime = Builder::new_current_thread().enable_all().build()?;
    thread::spawn(move || {
        runtime.block_on(async {
            loop {
                let why = match timeout(SILENCE, events.poll()).await {
                    Ok(Ok(Mqtt::Incoming(Packet::ConnAck(_)))) => {
                        let told = inlet.offer(Event::Line { name: broker.to_string(), why: None });
                        if told && each(Happened::Connected) {
                            continue;
                        }
                        return;
                    }
                    Ok(Ok(Mqtt::Incoming(Packet::Publish(published)))) => match each(Happened::Came(&published)) {
                        true => continue,
                        false => return,
                    },
                    Ok(Ok(Mqtt::Incoming(Packet::SubAck(answer)))) if !is_granted(&answer) => {
                        "it refuses the subscription".into()
                    }
                    Ok(Ok(_)) => continue,
                    Ok(Err(error)) => broker.words(&error),
                    Err(_) => "it says nothing any more".into(),
                };
                // The waiting messages are dropped, because they will be old when there is a connection again.
                events.clean();
                events.reset_session_state();
                let told = inlet.offer(Event::Line { name: broker.to_string(), why: Some(why) });
                if !told || !each(Happened::Lost) {
                    return;
                }
                sleep(RETRY).await;
            }
        });
    });
    Ok(())
}
