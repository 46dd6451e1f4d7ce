"""Readers of figures and pages for the tests of reports."""

from html.parser import HTMLParser

VOID = {"meta", "link", "br", "use", "path", "circle", "ellipse"}


def overlapping(figure):
    """Pairs of visible texts whose boxes intersect."""
    figure.draw_without_rendering()
    texts = [*figure.texts, *(text for legend in figure.legends for text in legend.get_texts())]
    for axis in figure.get_axes():
        texts += [axis.xaxis.label, axis.yaxis.label, *axis.texts]
        if axis.get_legend() is not None:
            texts += axis.get_legend().get_texts()
        for line, k in ((axis.xaxis, 0), (axis.yaxis, 1)):
            low, high = sorted(line.get_view_interval())
            texts += [text for text in line.get_ticklabels() if low <= text.get_position()[k] <= high]
    boxes = [(text.get_text(), text.get_window_extent()) for text in texts if text.get_text() and text.get_visible()]
    return [(a, b) for k, (a, p) in enumerate(boxes) for b, q in boxes[:k] if p.overlaps(q)]


class Page(HTMLParser):
    """Elements with attributes, text by section, and whether tags close in order."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.stack, self.section, self.texts, self.broken = [], [], "", {}, []
        self.prose = []  # paragraphs and list items
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        found = dict(attributes)
        self.elements.append((tag, found))
        if tag == "section":
            self.section = found["id"]
        if tag in ("p", "li"):
            self.prose.append("")
        if tag not in VOID:
            self.stack.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))

    def handle_endtag(self, tag):
        if tag in VOID:
            return
        if not self.stack or self.stack.pop() != tag:
            self.broken.append(tag)
        if tag == "section":
            self.section = ""
        if tag in ("td", "th", "li", "p", "h2", "dt", "dd", "strong", "text"):
            self.handle_data(" ")

    def handle_data(self, data):
        if not {"style", "script"} & set(self.stack):
            self.texts[self.section] = self.texts.get(self.section, "") + data
            if self.prose and {"p", "li"} & set(self.stack):
                self.prose[-1] += data

    def all(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]

    def words(self, section):
        return " ".join(self.texts[section].split())
