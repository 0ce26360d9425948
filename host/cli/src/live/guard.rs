//! Who may ask for what: only pages of this program, and whoever has the token.
//!
//! # Design
//! A browser that was lured to another site sends that site's name: as `Origin` with what it posts and with sockets that it opens, and, where
//! a name of that site was made to point at the loopback address (DNS rebinding), as `Host`. Both are held against a list, never against
//! each other. The token stands in the address behind `#`, which no browser sends: the page itself hands it over.

use axum::http::{HeaderMap, StatusCode, header};

/// Why a request is refused: a status and a sentence.
pub(crate) type Refusal = (StatusCode, String);

/// Bytes of a token, in hexadecimal digits.
const TOKEN: usize = 32;

/// Which names this server has, and the token.
#[derive(Clone, Debug)]
pub(crate) struct Guard {
    hosts: [String; 2],
    token: String,
}

impl Guard {
    /// That of a server at this `port` of the loopback address; `random` is what nobody can guess.
    pub(crate) fn new(port: u16, random: [u64; 2]) -> Self {
        Self {
            hosts: ["127.0.0.1", "localhost"].map(|name| format!("{name}:{port}")),
            token: random.map(|half| format!("{half:016x}")).concat(),
        }
    }

    /// The address of the page, with the token.
    pub(crate) fn url(&self) -> String {
        format!("http://{}/#{}", self.hosts[0], self.token)
    }

    /// Refuses what another site makes a browser ask for.
    pub(crate) fn check(&self, headers: &HeaderMap) -> Result<(), Refusal> {
        let said = |name| headers.get(name).map(|value| value.to_str().unwrap_or("no text"));
        let host = said(header::HOST).unwrap_or("none");
        if !self.hosts.iter().any(|known| known == host) {
            return Err(Self::refused("Host", &self.hosts[0], host));
        }
        match said(header::ORIGIN) {
            None => Ok(()),
            Some(origin) if self.hosts.iter().any(|known| origin == format!("http://{known}")) => Ok(()),
            Some(origin) => Err(Self::refused(
                "Origin",
                &format!("http://{}", self.hosts[0]),
                origin,
            )),
        }
    }

    fn refused(what: &str, expected: &str, found: &str) -> Refusal {
        let found: String = found.chars().filter(|c| !c.is_control()).take(100).collect();
        (
            StatusCode::FORBIDDEN,
            format!("{what}: expected {expected}, found {found}\n"),
        )
    }

    /// Refuses who has not the token: it stands in `Authorization: Bearer TOKEN`.
    pub(crate) fn check_token(&self, headers: &HeaderMap) -> Result<(), Refusal> {
        let said = headers
            .get(header::AUTHORIZATION)
            .and_then(|value| value.to_str().ok());
        let token = said.and_then(|text| text.strip_prefix("Bearer "));
        if token.is_some_and(|token| self.is_token(token)) {
            return Ok(());
        }
        Err((
            StatusCode::UNAUTHORIZED,
            "Authorization: expected Bearer and the token behind # in the address that `rcg live` printed, found another or none\n".to_owned(),
        ))
    }

    /// Whether `text` is the token, in a time that does not depend on how much of it is.
    pub(crate) fn is_token(&self, text: &str) -> bool {
        let differ = text
            .bytes()
            .zip(self.token.bytes())
            .fold(0, |all, (one, other)| all | (one ^ other));
        text.len() == TOKEN && differ == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_sites_and_whoever_has_no_token_are_refused() {
        let guard = Guard::new(8123, [1, 0xabc]);
        assert_eq!(
            guard.url(),
            "http://127.0.0.1:8123/#00000000000000010000000000000abc"
        );
        let headers = |all: &[(header::HeaderName, &str)]| -> HeaderMap {
            all.iter()
                .map(|(name, value)| (name.clone(), value.parse().unwrap()))
                .collect()
        };
        let host = (header::HOST, "localhost:8123");
        for origin in ["http://localhost:8123", "http://127.0.0.1:8123"] {
            guard
                .check(&headers(&[host.clone(), (header::ORIGIN, origin)]))
                .unwrap();
        }
        guard.check(&headers(std::slice::from_ref(&host))).unwrap();
        for foreign in [
            "http://evil.example",
            "null",
            "https://localhost:8123",
            "http://localhost:8124",
            "http://localhost:8123.evil.example",
        ] {
            let (status, sentence) = guard
                .check(&headers(&[host.clone(), (header::ORIGIN, foreign)]))
                .unwrap_err();
            assert!(
                status == StatusCode::FORBIDDEN && sentence.contains(foreign),
                "{sentence}"
            );
        }
        for foreign in ["evil.example:8123", "localhost", "127.0.0.1:80"] {
            assert!(
                guard.check(&headers(&[(header::HOST, foreign)])).is_err(),
                "{foreign}"
            );
        }
        assert!(guard.check(&HeaderMap::new()).is_err());
        let bearer = |token: &str| headers(&[(header::AUTHORIZATION, &format!("Bearer {token}"))]);
        guard
            .check_token(&bearer("00000000000000010000000000000abc"))
            .unwrap();
        for wrong in [
            "",
            "0",
            "00000000000000010000000000000abd",
            "00000000000000010000000000000abc0",
        ] {
            assert!(guard.check_token(&bearer(wrong)).is_err(), "{wrong}");
        }
        assert!(guard.check_token(&HeaderMap::new()).is_err());
    }
}
