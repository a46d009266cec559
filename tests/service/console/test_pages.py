"""Lists by pages, which stay whole while they are read anew."""

from pathlib import Path

from playwright.sync_api import Browser, expect

from tests.service.console.conftest import opened
from tests.service.harness import API_COMMAND, Service
from tests.worker.waiting import PATIENCE

expect.set_options(timeout=PATIENCE * 1000)


def test_what_was_shown_of_a_list_is_still_shown_once_it_is_read_anew(browser: Browser, tmp_path: Path) -> None:
    service = Service(tmp_path, log_level="WARNING")
    with service.running(API_COMMAND):
        urls = [service.start_job() for _ in range(25)]
        oldest = urls[0].rpartition("/")[2]
        with opened(browser, service.url + "/#/jobs") as page:
            jobs, more = page.locator("ul.jobs > li"), page.get_by_role("button", name="Show more")
            expect(jobs).to_have_count(20)
            more.click()
            expect(jobs).to_have_count(25)
            expect(more).to_have_count(0)

            service.client.delete(urls[0])
            expect(jobs.filter(has=page.locator(f'a[href$="{oldest}"]'))).to_contain_text("Canceled")
            assert jobs.count() == 25

            page.get_by_role("button", name="Canceled").click()
            expect(jobs).to_have_count(1)
            expect(more).to_have_count(0)
            page.get_by_role("button", name="All", exact=True).click()
            expect(jobs).to_have_count(20)
            expect(more).to_be_visible()
