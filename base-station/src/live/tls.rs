//! TLS to a broker, by `rustls` with `ring` (decision 19).
//!
//! Who signs the broker's certificate is always said, and no other authority counts: a fleet's broker has one that the
//! fleet signed itself, and whoever takes a public one names the system's bundle of authorities. The broker's
//! certificate must be for the name by which it was called, and TLS be of version 1.2 or 1.3. What is wrong is told in
//! words by which one knows what to mend.
//!
//! Without this crate's feature `tls` there is no [`Tls`], and [`Tls::new`] says so.

use std::error::Error;
use std::fmt;

use rumqttc::Transport;

/// Why there can be no TLS with these certificates.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Unusable {
    /// This program was built without TLS.
    NotBuilt,
    /// There is no certificate of an authority, or none that can be read.
    NoAuthority,
    /// There is no certificate of this station, or it cannot be read.
    NoCertificate,
    /// There is no private key, or it cannot be read: it must not be encrypted.
    NoKey,
    /// Certificate and key do not fit, or are of a kind that is not known; in words.
    Refused(String),
}

impl fmt::Display for Unusable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotBuilt => f.write_str("this program was built without TLS"),
            Self::NoAuthority => f.write_str("no certificate of an authority is in it, as PEM"),
            Self::NoCertificate => f.write_str("no certificate is in it, as PEM"),
            Self::NoKey => f.write_str("no private key is in it that is not encrypted, as PEM"),
            Self::Refused(why) => write!(f, "certificate and key cannot be used: {why}"),
        }
    }
}

impl Error for Unusable {}

#[cfg(feature = "tls")]
pub use with::Tls;
#[cfg(not(feature = "tls"))]
pub use without::Tls;

#[cfg(feature = "tls")]
mod with {
    use std::io;
    use std::sync::Arc;

    use rumqttc::TlsConfiguration;
    use rustls::crypto::ring;
    use rustls::pki_types::pem::PemObject;
    use rustls::pki_types::{CertificateDer, PrivateKeyDer};
    use rustls::{CertificateError, ClientConfig, RootCertStore};

    use super::{Error, Transport, Unusable};

    /// What stands before an alert's name in the words of `rustls`.
    const ALERT: &str = "received fatal alert: ";

    /// Which authorities are trusted, and this station's own certificate if it has one.
    #[derive(Clone)]
    pub struct Tls(Arc<ClientConfig>);

    impl Tls {
        /// Trusts a broker whose certificate one of the `authorities` signed. `client` is this station's certificate,
        /// followed by the intermediate ones, and its private key, for a broker that asks for them. All are PEM.
        ///
        /// # Errors
        ///
        /// If there are none in it, or they cannot be used.
        pub fn new(authorities: &[u8], client: Option<(&[u8], &[u8])>) -> Result<Self, Unusable> {
            let mut roots = RootCertStore::empty();
            // A system's bundle may have one that is too old to be read.
            roots.add_parsable_certificates(CertificateDer::pem_slice_iter(authorities).flatten());
            if roots.is_empty() {
                return Err(Unusable::NoAuthority);
            }
            let refused = |error: rustls::Error| Unusable::Refused(error.to_string());
            let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()));
            let config = config.with_safe_default_protocol_versions().map_err(refused)?.with_root_certificates(roots);
            let config = match client {
                None => config.with_no_client_auth(),
                Some((certificate, key)) => {
                    let chain: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(certificate).collect();
                    let chain = chain.ok().filter(|chain| !chain.is_empty()).ok_or(Unusable::NoCertificate)?;
                    let key = PrivateKeyDer::from_pem_slice(key).map_err(|_| Unusable::NoKey)?;
                    config.with_client_auth_cert(chain, key).map_err(refused)?
                }
            };
            Ok(Self(Arc::new(config)))
        }

        pub(in crate::live) fn transport(&self) -> Transport {
            Transport::tls_with_config(TlsConfiguration::Rustls(Arc::clone(&self.0)))
        }

        /// What went wrong, in words, if it was TLS: with a broker that was called `host`.
        pub(in crate::live) fn words(&self, error: &rumqttc::ConnectionError, host: &str) -> Option<String> {
            if let Some(error) = find(error) {
                return Some(words(error, host));
            }
            // What a broker says once the handshake is over, as of a certificate that is missing in TLS 1.3, is left of
            // it in words alone (rumqttc-v5-next 0.34).
            let text = error.to_string();
            text.split_once(ALERT).map(|(_, name)| alert(name))
        }
    }

    /// TLS's own error among the causes of one.
    fn find<'a>(error: &'a (dyn Error + 'static)) -> Option<&'a rustls::Error> {
        let mut next = Some(error);
        while let Some(error) = next {
            // What an I/O error holds is not its source, but itself.
            let inner = error.downcast_ref::<io::Error>().and_then(io::Error::get_ref);
            let found = error.downcast_ref().or_else(|| inner.and_then(|inner| inner.downcast_ref()));
            if found.is_some() {
                return found;
            }
            next = error.source();
        }
        None
    }

    fn words(error: &rustls::Error, host: &str) -> String {
        use CertificateError as Bad;
        match error {
            rustls::Error::InvalidCertificate(bad) => match bad {
                Bad::UnknownIssuer => "its certificate is signed by none of the authorities in --ca".into(),
                Bad::Expired | Bad::ExpiredContext { .. } => "its certificate has expired".into(),
                Bad::NotValidYet | Bad::NotValidYetContext { .. } => {
                    "its certificate is not valid yet, or this machine's clock is wrong".into()
                }
                Bad::NotValidForName | Bad::NotValidForNameContext { .. } => {
                    format!("its certificate is for another name than {host}")
                }
                bad => format!("its certificate is not valid: {bad}"),
            },
            rustls::Error::AlertReceived(received) => alert(&format!("{received:?}")),
            error => format!("TLS: {error}"),
        }
    }

    /// What the broker complains of by an alert of this name (RFC 8446, section 6).
    fn alert(name: &str) -> String {
        match name {
            "CertificateRequired" => {
                "it wants a certificate of this station: --certificate and --certificate-key".into()
            }
            "CertificateExpired" => "it says that this station's certificate has expired".into(),
            "UnknownCA" | "BadCertificate" | "CertificateUnknown" | "DecryptError" => {
                format!("it does not believe this station's certificate: {name}")
            }
            // In TLS 1.2 this is all that is said of a certificate that is missing.
            name => format!("it ends TLS with {name}"),
        }
    }
}

#[cfg(not(feature = "tls"))]
mod without {
    use super::{Transport, Unusable};

    /// There is none.
    #[derive(Clone)]
    pub enum Tls {}

    impl Tls {
        /// There is none.
        ///
        /// # Errors
        ///
        /// Always [`Unusable::NotBuilt`].
        pub const fn new(_authorities: &[u8], _client: Option<(&[u8], &[u8])>) -> Result<Self, Unusable> {
            Err(Unusable::NotBuilt)
        }

        pub(in crate::live) const fn transport(&self) -> Transport {
            match *self {}
        }

        pub(in crate::live) const fn words(&self, _: &rumqttc::ConnectionError, _: &str) -> Option<String> {
            match *self {}
        }
    }
}

#[cfg(all(test, feature = "tls"))]
mod tests {
    use std::io;

    use rumqttc::ConnectionError;
    use rustls::AlertDescription;

    use super::*;

    #[test]
    fn an_alert_is_told_alike_whether_it_comes_as_an_error_or_in_words() {
        let ca = rcgen::generate_simple_self_signed([]).unwrap().cert.pem();
        let tls = Tls::new(ca.as_bytes(), None).unwrap();
        for alert in [AlertDescription::CertificateRequired, AlertDescription::UnknownCA] {
            let error = rustls::Error::AlertReceived(alert);
            let words = error.to_string();
            let kept = ConnectionError::Io(io::Error::new(io::ErrorKind::InvalidData, error));
            let told = tls.words(&kept, "broker").unwrap();
            assert!(told.contains("certificate"), "{told}");
            assert_eq!(tls.words(&ConnectionError::Io(io::Error::other(words)), "broker"), Some(told));
        }
        let other = ConnectionError::Io(io::ErrorKind::ConnectionReset.into());
        assert_eq!(tls.words(&other, "broker"), None);
    }
}
