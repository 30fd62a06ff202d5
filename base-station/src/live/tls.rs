//! Encrypts connections to a broker by TLS, with `rustls` and `ring` (decision 19).
//!
//! The user must name the authority that signs the broker's certificate; no other is trusted. A fleet's own broker has
//! a certificate that the fleet signed. For a public broker the user names the system's bundle of authorities. The
//! certificate must be for the name in the broker's address, and TLS must be of version 1.2 or 1.3. Errors say what to
//! correct.
//!
//! Without the feature `tls`, no [`Tls`] can exist, and [`Tls::new`] returns [`Unusable::NotBuilt`].

use std::error::Error;
use std::fmt;

use rumqttc::Transport;

/// The reason why TLS cannot be used with these certificates.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Unusable {
    /// This program was built without TLS.
    NotBuilt,
    /// There is no readable certificate of an authority.
    NoAuthority,
    /// There is no readable certificate of this station.
    NoCertificate,
    /// There is no readable private key. An encrypted key cannot be read.
    NoKey,
    /// Certificate and key do not match, or are of an unknown kind. The text is the reason.
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

    const ALERT: &str = "received fatal alert: ";

    /// The trusted authorities, and this station's own certificate if it has one.
    #[derive(Clone)]
    pub struct Tls(Arc<ClientConfig>);

    impl Tls {
        /// Returns settings that trust a broker whose certificate one of the `authorities` signed. For a broker that
        /// requires them, `client` has this station's certificate with the intermediate ones, and its private key. All
        /// of these are PEM.
        ///
        /// # Errors
        ///
        /// Returns an error if a file has no certificate or key, or one that cannot be used.
        pub fn new(authorities: &[u8], client: Option<(&[u8], &[u8])>) -> Result<Self, Unusable> {
            let mut roots = RootCertStore::empty();
            // A system's bundle of authorities may contain certificates that cannot be read. These are skipped.
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

        pub(in crate::live) fn words(&self, error: &rumqttc::ConnectionError, host: &str) -> Option<String> {
            if let Some(error) = find(error) {
                return Some(words(error, host));
            }
            // After the handshake, rumqttc-v5-next 0.34 reports an alert only as text. In TLS 1.3, a missing
            // certificate is reported this way.
            let text = error.to_string();
            text.split_once(ALERT).map(|(_, name)| alert(name))
        }
    }

    fn find<'a>(error: &'a (dyn Error + 'static)) -> Option<&'a rustls::Error> {
        let mut next = Some(error);
        while let Some(error) = next {
            // An I/O error's `source` skips the error inside. Only `get_ref` returns that error.
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

    fn alert(name: &str) -> String {
        match name {
            "CertificateRequired" => {
                "it wants a certificate of this station: --certificate and --certificate-key".into()
            }
            "CertificateExpired" => "it says that this station's certificate has expired".into(),
            "UnknownCA" | "BadCertificate" | "CertificateUnknown" | "DecryptError" => {
                format!("it does not believe this station's certificate: {name}")
            }
            name => format!("it ends TLS with {name}"),
        }
    }
}

#[cfg(not(feature = "tls"))]
mod without {
    use super::{Transport, Unusable};

    /// A type without values, so that a program without TLS cannot make one.
    #[derive(Clone)]
    pub enum Tls {}

    impl Tls {
        /// Always fails, because this program was built without TLS.
        ///
        /// # Errors
        ///
        /// Returns [`Unusable::NotBuilt`] in all cases.
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
    fn an_alert_is_explained_alike_as_an_error_and_as_text() {
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
