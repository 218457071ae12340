from jointgap.core.page import to_markdown
from jointgap.scenario.overview import overview, overview_page


def test_the_page_of_all_scenarios_is_there_where_none_has_an_optimum():
    assert "No lengths satisfy the constraints in any scenario" in to_markdown(
        overview_page(overview({}))
    )
