"""The router's configuration for a fleet: mutual TLS, and who may write what."""

import json
from collections.abc import Sequence
from typing import Any

from companion.errors import LandslopeError
from drivers.bus import IMPORTANT_BATCHES

HEAD = """\
// A zenoh router for a fleet: everybody shows a certificate, a vehicle can write only under its own name,
// a watcher can write nothing, and a certificate that is not named here can do nothing at all.
// Made by 'landslope fleet router'; docs/fleet.md says how to use it.
"""
WRITING = ["put", "delete", "reply", "declare_queryable", "liveliness_token"]
HEARING = "vehicles hear who reads"
READING = ["query", "declare_subscriber", "liveliness_query", "declare_liveliness_subscriber"]


def checked_names(names: Sequence[str]) -> list[str]:
    """The names, if each can be part of a key and a certificate's common name; LandslopeError otherwise."""
    for name in names:
        if not name or any(not (c.isascii() and (c.isalnum() or c in "-_.")) for c in name):
            raise LandslopeError(f"'{name}' cannot be a name: use letters, digits, '-', '_' and '.'")
    if len(set(names)) < len(names):
        raise LandslopeError("two of the fleet's certificates have the same name; every one needs its own")
    return list(names)


def access_control(vehicles: Sequence[str], watchers: Sequence[str]) -> dict[str, Any]:
    """zenoh's ``access_control``: subjects are the certificates' common names, all else is denied.

    Flows are the router's own: "ingress" is what a client sends it, "egress" what it passes on to a client.
    """
    checked_names([*vehicles, *watchers])
    rules: list[dict[str, Any]] = []
    subjects: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    everything = ["landslope/**"]
    for vehicle in vehicles:
        own = [f"landslope/{vehicle}/**"]
        rules.append(_rule(f"{vehicle} writes its own", "ingress", WRITING, own))
        subjects.append({"id": vehicle, "cert_common_names": [vehicle]})
        policies.append({"subjects": [vehicle], "rules": [f"{vehicle} writes its own", HEARING]})
    if vehicles:
        # Who reads, not what is written: without it a publisher sends nothing. A rule covers a subscription
        # only if it includes all of it, and watchers subscribe to "landslope/*/...".
        rules.append(_rule(HEARING, "egress", READING, everything))
    if watchers:
        rules.append(_rule("watchers ask", "ingress", READING, everything))
        rules.append(_rule("watchers hear", "egress", WRITING, everything))
        subjects.append({"id": "watchers", "cert_common_names": list(watchers)})
        policies.append({"subjects": ["watchers"], "rules": ["watchers ask", "watchers hear"]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def router_config(
    vehicles: Sequence[str], watchers: Sequence[str], listen: str, certificates: str
) -> dict[str, Any]:
    """The whole configuration; ``certificates`` is the folder of ca.pem, router.pem and router.key."""
    return {
        "mode": "router",
        "listen": {"endpoints": [listen]},
        "scouting": {"multicast": {"enabled": False}},
        "transport": {
            "link": {
                "tx": {"queue": {"size": {"interactive_high": IMPORTANT_BATCHES}}},
                "tls": {
                    "root_ca_certificate": f"{certificates}/ca.pem",
                    "listen_certificate": f"{certificates}/router.pem",
                    "listen_private_key": f"{certificates}/router.key",
                    "enable_mtls": True,
                    "close_link_on_expiration": True,
                },
            }
        },
        "access_control": access_control(vehicles, watchers),
    }


def client_config(name: str, connect: str, certificates: str) -> dict[str, Any]:
    """A vehicle's or a watcher's side; ``name`` is its certificate's common name and its files' name."""
    checked_names([name])
    return {
        "mode": "client",
        "connect": {"endpoints": [connect]},
        "scouting": {"multicast": {"enabled": False}},
        "transport": {
            "link": {
                "tls": {
                    "root_ca_certificate": f"{certificates}/ca.pem",
                    "connect_certificate": f"{certificates}/{name}.pem",
                    "connect_private_key": f"{certificates}/{name}.key",
                    "enable_mtls": True,
                    "verify_name_on_connect": True,
                }
            }
        },
    }


def as_json5(config: dict[str, Any], head: str = HEAD) -> str:
    """The file's text."""
    return head + json.dumps(config, indent=2) + "\n"


def _rule(name: str, flow: str, messages: list[str], keys: list[str]) -> dict[str, Any]:
    return {"id": name, "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys}
