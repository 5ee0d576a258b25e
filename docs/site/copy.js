// A copy button copies what one types: of a terminal the commands, without prompt, comments and output.

const PROMPT = /^\w*\$\s+/;

function commands(text, language) {
  let lines = text.split("\n");
  if (language === "console") {
    lines = lines.filter((line) => PROMPT.test(line)).map((line) => line.replace(PROMPT, ""));
  }
  return lines.map((line) => line.replace(/(^|\s+)# .*$/, "")).filter((line) => line.trim()).join("\n");
}

document.addEventListener("click", (event) => {
  const button = event.target.closest?.("[data-clipboard-target]");
  const block = button?.closest(".language-console, .language-sh");
  const code = block?.querySelector("code");
  if (code) {
    const language = block.classList.contains("language-console") ? "console" : "sh";
    button.dataset.clipboardText = commands(code.textContent, language);
  }
}, true);
