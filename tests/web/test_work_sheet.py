"""The page to check and sign: one file, one page of paper, with the box, what to tick off and who signs."""

import pytest

from benchmarks.harness.site import Site
from tests.web.conftest import Opened

pytestmark = pytest.mark.browser


def test_it_is_one_page_of_paper_with_what_to_do_and_who_signs(opened: Opened, site: Site) -> None:
    with opened("viewer", f"/investigations/{site.investigation}/work-sheet") as page:
        text = page.locator("main").inner_text()
        for part in ("What", "How sure", "Do now, in this order", "Afterwards measure", "repaired", "Signature"):
            assert part in text
        assert page.locator("script").count() == 0
        assert page.pdf(format="A4").count(b"/Type /Page\n") == 1
