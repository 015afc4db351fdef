"""Every answer of the page's server carries its policy; pages of other addresses are refused."""

import asyncio

import pytest

from uniart_jax.app.serve import POLICY, WithPolicy

OURS = ("http://127.0.0.1:7860", "http://localhost:7860")


def answer(headers, kind="http"):
    """What is sent back for a request with these headers; None: it got through to the page."""
    sent = []

    async def page(scope, receive, send):
        await send({"type": "http.response.start", "status": 200, "headers": [(b"a", b"b")]})

    async def send(message):
        sent.append(message)

    scope = {"type": kind, "headers": headers}
    asyncio.run(WithPolicy(page, OURS)(scope, None, send))
    return sent


@pytest.mark.parametrize("origin", [None, *OURS])
def test_our_own_page_is_answered_with_the_policy(origin):
    headers = [(b"host", b"127.0.0.1:7860")] + ([(b"origin", origin.encode())] if origin else [])
    (start,) = answer(headers)
    assert start["status"] == 200
    assert (b"content-security-policy", POLICY.encode()) in start["headers"]


@pytest.mark.parametrize(
    "origin", ["https://evil.example", "null", "http://127.0.0.1:7861", "http://127.0.0.1:78601"]
)
def test_pages_of_other_addresses_are_refused(origin):
    start, body = answer([(b"origin", origin.encode())])
    assert start["status"] == 403 and body["body"] == b"another page's request"
