// The menu of versions in the sidebar of each page, from the list that docs/make_site.py puts above.
{
  const root = new URL(".", document.currentScript.src).href;
  const [here, ...path] = location.href.slice(root.length).split("/");
  const menu = document.createElement("select");
  menu.setAttribute("aria-label", "Version of these pages");
  menu.autocomplete = "off"; // a browser that reloads the page keeps no other choice
  menu.style = "display: block; margin: 0 var(--sidebar-item-spacing-horizontal, 1rem) 0.75rem;"
    + "padding: 0.25rem; font: inherit; font-size: 0.875rem;"
    + "color: var(--color-foreground-primary, #000); border: 1px solid var(--color-foreground-muted, gray);"
    + "background: var(--color-background-primary, #fff)";
  for (const { name, status } of versions) {
    menu.add(new Option(`${name} (${status})`, name, name === here, name === here));
  }
  menu.addEventListener("change", async () => {
    const chosen = `${root}${menu.value}/`;
    menu.value = here; // for a reader who comes back
    // That version may lack this page; for pages opened as files, a browser cannot ask.
    const page = chosen + path.join("/");
    const found = await fetch(page, { method: "HEAD" }).then((answer) => answer.ok, () => false);
    location.href = found ? page : `${chosen}index.html`;
  });
  document.querySelector(".sidebar-brand")?.after(menu);
}
