"""Which requests that change something are taken, by what their heads say of where they come from."""

from __future__ import annotations

import pytest
from starlette.requests import Request

from service.origin import why_foreign

JSON = {"content-type": "application/json"}
FORM = {"content-type": "application/x-www-form-urlencoded"}
FILES = {"content-type": "multipart/form-data; boundary=x"}
TEXT = {"content-type": "text/plain"}
CURL, BROWSER = {"user-agent": "curl/8.5"}, {"user-agent": "Mozilla/5.0 (X11)"}
HOST = "127.0.0.1:8017"


def request(headers: dict[str, str], *, host: str = HOST, scheme: str = "http", method: str = "POST") -> Request:
    raw = [(name.encode(), value.encode()) for name, value in ({"host": host} | headers).items()]
    return Request(
        {"type": "http", "method": method, "scheme": scheme, "path": "/x", "query_string": b"", "headers": raw}
    )


FOREIGN = {
    "another port of this machine": {"origin": "http://127.0.0.1:9000"} | JSON,
    "another name of this machine": {"origin": "http://localhost:8017"},
    "another scheme": {"origin": f"https://{HOST}"},
    "another site": {"origin": "https://evil.example"},
    "a sandboxed frame or a file": {"origin": "null"} | JSON,
    "our name in another's": {"origin": f"http://{HOST}.evil.example"},
    "our name as a user": {"origin": f"http://{HOST}@evil.example"},
    "an empty origin": {"origin": ""},
    "a path behind the origin": {"origin": f"http://{HOST}/"},
    "no port where ours has one": {"origin": "http://127.0.0.1"},
    "cross-site, by its own word": {"sec-fetch-site": "cross-site"} | JSON,
    "same-site, by its own word": {"sec-fetch-site": "same-site"} | JSON,
    "our origin, but same-site": {"origin": f"http://{HOST}", "sec-fetch-site": "same-site"},
    "a form of an old browser": FORM | BROWSER,
    "an empty form of an old browser": FORM | BROWSER | {"content-length": "0"},
    "a form with files of an old browser": FILES | BROWSER,
    "a form of text": TEXT | BROWSER,
    "a form by a program": FORM | CURL,
    "a password that a browser adds by itself": FILES | BROWSER | {"authorization": "Basic eDp5"},
}
OWN = {
    "our page": {"origin": f"http://{HOST}", "sec-fetch-site": "same-origin"} | FILES | BROWSER,
    "our page in a browser that says less": {"origin": f"http://{HOST}"} | JSON | BROWSER,
    "our page, from another case": {"origin": f"HTTP://{HOST}"},
    "curl with JSON": JSON | CURL,
    "curl with a file": FILES | CURL,
    "curl without a body": CURL,
    "a program without a name": FILES,
    "a script with its own header": FILES | BROWSER | {"x-requested-with": "x"},
    "a program with a key": FILES | BROWSER | {"authorization": "Bearer x"},
    "JSON from an old browser, which no form sends": JSON | BROWSER,
}


@pytest.mark.parametrize("what", FOREIGN)
def test_what_may_be_of_another_page_is_refused(what: str) -> None:
    assert why_foreign(request(FOREIGN[what]), False)


@pytest.mark.parametrize("what", OWN)
def test_our_page_and_programs_are_let_in(what: str) -> None:
    assert why_foreign(request(OWN[what]), False) is None


@pytest.mark.parametrize("method", ["PUT", "PATCH", "DELETE"])
def test_every_method_that_changes_something_is_looked_at(method: str) -> None:
    assert why_foreign(request({"origin": "https://evil.example"}, method=method), False)


def test_reading_is_no_change() -> None:
    assert why_foreign(request({"origin": "https://evil.example"}, method="GET"), False) is None


def test_with_keys_a_form_matters_once_there_is_a_cookie() -> None:
    assert why_foreign(request(FORM), True) is None, "the form for the key itself"
    assert why_foreign(request(FORM | {"cookie": "fredholm_key=x"}), True)
    assert why_foreign(request({"origin": "https://evil.example"}), True)


def test_usual_ports_need_not_be_named() -> None:
    for scheme, port in (("http", 80), ("https", 443)):
        for host in ("a.example", f"a.example:{port}"):
            for origin in (f"{scheme}://a.example", f"{scheme}://a.example:{port}"):
                assert why_foreign(request({"origin": origin}, host=host, scheme=scheme), True) is None


def test_addresses_in_brackets_are_compared_too() -> None:
    assert why_foreign(request({"origin": "http://[::1]:8017"}, host="[::1]:8017"), False) is None
    assert why_foreign(request({"origin": "http://[::1]:9000"}, host="[::1]:8017"), False)


def test_a_host_that_is_none_opens_nothing() -> None:
    assert why_foreign(request({"origin": "http://"}, host=""), False)
    assert why_foreign(request({"origin": "http://a:b"}, host="a:b"), False)
